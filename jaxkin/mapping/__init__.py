"""What the equations and the fields mean: singular curves and surfaces, cusps."""
