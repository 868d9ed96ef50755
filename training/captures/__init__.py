"""Captures: Gaussians optimised from images of furnished rooms in which somebody moves; needs numba.

    python -m training.captures capture_kitchen

`training.fitting` begins with rough copies of the true Gaussians and looks at an object from outside. Here
nothing is known but images and cameras, as in a real capture: the cameras stand in one region and look at a
room, which is rendered as textured triangles.

    frame 0        from random points in the cameras' view, with densification, pruning and opacity resets as
                   in 3DGS (Kerbl et al. 2023); what this leaves of floaters and huge Gaussians stays
    later frames   positions and rotations only, as `training.fitting.track` finds them

start       the first, random Gaussians
densify     clone, split, prune, reset
optimise    frame 0, with checkpoints
fit         all of it in turn, into the file of `lab.scenes.fitted`

The rooms, their images and their cameras are those of `lab.captures`. The fit is reproducible on one machine,
not to the bit on another, hence the stored file is the sequence by definition.
"""
