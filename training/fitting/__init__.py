"""Fitted sequences: Gaussians optimised frame after frame against images, as 3DGStream does; needs numba.

    python -m training.fitting fitted_mage --frames 20

The generator's other sequences move every Gaussian exactly as the truth does. Here nobody knows the truth: a
dense animated character on a still stage is rendered from a ring of cameras, and far fewer Gaussians are
fitted to the images alone.

    frame 0        all attributes, N fixed, the loss and learning rates of 3DGS (Kerbl et al. 2023)
    later frames   only positions and rotations, starting from the frame before as it is *stored*; what no
                   camera sees change stays bit-identical

So the motion has what a tracker's output has: jitter, drift, slips along the surface, hidden parts that
follow their neighbours, and a few per cent of the background that are dragged along.

stage       what stands still around the character
sequences   the sequences by name; the true frames
capture     cameras, images of the truth, PSNR
first       frame 0
activity    which Gaussians move
deform      the smooth field by which they move
track       later frames
store       the file; `lab.scenes.fitted` reads it without numba
fit         all of it in turn, into the file; continues a file that is there
report      quality and statistics per frame: `evaluation/results/fitted.json`

The fit is reproducible on one machine, not to the bit on another (see `lab.render.kernel`), hence the
stored file is the sequence by definition.
"""
