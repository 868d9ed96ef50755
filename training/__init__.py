"""Training of the frozen models, and the fitting of Gaussians to images; imports the codec and `lab`."""
