"""Files of numpy arrays that hold a whole sequence.

archive   an .npz, whose arrays are read timestep by timestep
params    the params.npz of Dynamic 3D Gaussians as frames
"""
