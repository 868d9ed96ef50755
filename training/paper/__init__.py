"""Training of the networks of profile `paper`: the motion codec of D-FCGS, on generated sequences.

    prepare    sequences of the training group -> GoFs on disk, coded I-frames and targets in integers
    gof        one prepared GoF: its arrays, its file
    inputs     what the networks read: frequency encoding, grid corners, appearance, in the codec's formats
    data       the GoFs of a folder
    samples    a GoF as tensors, augmented, and several of them as one batch
    nets       the networks in float, with the clipping of the integer ones
    factorised the distribution of hyper latents (Balle et al. 2018)
    warm_up    the first stage: random pairs of points
    coding     a batch through the codec: latents with noise or rounded, rates, compensation, closed loop
    losses     rate and distortion of geometry
    rendering  the render loss, with colour refinement
    config     what a run is told; stages, steps, learning rates
    objectives what the stages minimise
    train      the loop, checkpoints, curves
    integers   the integer layers, evaluated in numpy and in torch
    export     float networks -> integer model files
    report     figures of a model by sequence, float and integer

Needs torch, of the extra [train]; rendering losses need numba, of [eval]. The codec never imports this.
"""
