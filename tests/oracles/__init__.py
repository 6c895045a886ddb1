"""Exact oracles: slow, independent answers against which the library is tested."""
