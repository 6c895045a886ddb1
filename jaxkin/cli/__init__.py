"""The command line: parses, calls, prints; holds no mathematics and starts without JAX."""
