"""Which Gaussian of a frame is which one of the frame before."""
