"""float64 for every test; property tests without deadlines and always with the same examples."""

import hypothesis

import jaxkin

jaxkin.enable_x64()
hypothesis.settings.register_profile("jaxkin", deadline=None, derandomize=True)
hypothesis.settings.load_profile("jaxkin")
