"""What errors look like: Gaussians drawn in small patches and along rays."""
