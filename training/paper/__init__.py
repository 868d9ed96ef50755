"""Training of the networks of profile `paper`: D-FCGS's dual-prior motion codec, on sequences of this project's own.

    prepare    sequences of the training group -> GoFs on disk, coded I-frames and targets in integers
    gof        one prepared GoF: its arrays, its file
    inputs     what the networks read: frequency encoding, grid corners, appearance, as the codec computes them
    samples    a GoF as tensors, augmented, and several of them as one batch
    nets       the networks in float, with the clipping of the integer ones
    factorised the distribution of hyper latents (Balle et al. 2018)
    coding     a batch through the codec: latents with noise or rounded, rates, compensation, closed loop
    losses     geometry and rendering losses
    schedule   how long, how fast, at which steps
    train      the loop, checkpoints, curves
    integers   the integer layers, evaluated in numpy and in torch
    export     float networks -> integer model files
    report     figures of a model by sequence, float and integer

Needs torch, of the extra [train]; rendering losses need numba, of [eval]. The codec never imports this.
"""
