"""What training and evaluation share: moving scenes, a renderer, cameras, assets, records of results.

scenes              the generator of moving sequences, and the catalogue of all scenes
meshes              glTF files: triangles, poses, colours
captures            furnished rooms in which somebody moves: their images and cameras
render              a rasteriser of Gaussians with gradients, and SSIM; needs numba
render_reference    the rasteriser against other tools' images
views               the cameras that judge quality
quality             PSNR and SSIM between rendered clouds
attribute_errors    errors of Gaussians themselves
assets, record      where assets lie; results as JSON

It imports the codec and nothing else of this repository.
"""
