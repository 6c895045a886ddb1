"""Reports: what was computed, told to a reader, with its figures and tables."""
