"""What the command line calls what messages name as arguments and functions of Python."""

#: A word of ``jaxkin.core.words.given`` -> that of the command line.
OPTIONS = {
    "overwrite=True": "--force",
    "file": "folder",
    "store": "--store",
    "store=...": "--store STORE",
    "workers": "--workers",
    "executor": "--scheduler",
    "adaptive": "--adaptive",
    "label": "--label",
    "jk.Adaptive(label='sign')": "--label sign",
    "jk.Adaptive: stride": "--stride",
    "jk.Adaptive: probes": "--probes",
    "jk.Adaptive: seed": "--seed",
    "jk.Adaptive: proof": "--proof",
    "precision is 'float32'": "--float32 is given",
    "use 'float64'": "leave it out",
    "precision='float64'": "float64: leave --float32 out",
    "Grid()": "The grid",
    "(low, high, n)": "--grid AXIS=LOW:HIGH:N",
    "a number to fix it": "--fix AXIS=VALUE",
    "one number": "--fix AXIS=VALUE",
    "jk.sweep: ": "",
    "write the result, which is an xarray.Dataset": "give --out FOLDER for the result",
    "jk.open_store": "'jaxkin info'",
}
