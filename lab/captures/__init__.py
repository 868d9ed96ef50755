"""Captures: furnished rooms in which somebody moves, seen from within; their pictures need numba.

rooms       pieces of `assets/rooms` and their places; `shell`: floor and walls
mesh        rooms and characters as triangles
raster      which triangle a pixel shows
picture     its colour: texture, lamp, highlight
rigs        the cameras of the fit, and those between them
captures    the captures by name; their true images
keep        what lies beside a stored capture: `cameras.json` and true images between the cameras
files       the same by the name of a scene

`training.captures` fits Gaussians to the pictures.
"""
