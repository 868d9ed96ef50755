"""Captures: Gaussians optimised from images of furnished rooms in which somebody moves; needs numba.

    python -m training.captures capture_kitchen

`training.fitting` begins with rough copies of the true Gaussians and looks at an object from outside. Here
nothing is known but images and cameras, as in a real capture: the cameras stand in one region and look at a
room, which is rendered as textured triangles.

    frame 0        from random points in the cameras' view, with densification, pruning and opacity resets as
                   in 3DGS (Kerbl et al. 2023); what this leaves of floaters and huge Gaussians stays
    later frames   positions and rotations only, as `training.fitting.track` finds them

rooms       pieces of `assets/rooms` and their places
mesh        rooms and characters as triangles
raster      which triangle a pixel shows
picture     its colour: texture, lamp, highlight
rigs        the cameras of the fit, and those between them
captures    the captures by name; their true images
start       the first, random Gaussians
densify     clone, split, prune, reset
optimise    frame 0, with checkpoints
fit         all of it in turn, into the file of `training.scenes.fitted`
keep        what lies beside that file: `cameras.json` and the true images between the cameras

The fit is reproducible on one machine, not to the bit on another, hence the stored file is the sequence by
definition.
"""
