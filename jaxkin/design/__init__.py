"""Designs: which geometry serves best, and what every geometry of a family does."""
