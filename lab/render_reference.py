"""The renderer against other tools' images: `python -m lab.render_reference`.

gsplat            float64 images by its torch code (`tools/make_render_reference.py`); the same image
                  formation, so every pixel agrees but for rounding
splat-transform   an 8-bit image by its WebGPU rasteriser (`tools/make_splat_transform_reference.py`), which
                  approximates; agreement in dB only
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from PIL import Image

from dfcgs_codec import GaussianCloud
from dfcgs_codec.ply import read_ply
from lab.quality import VISIBLE_ALPHA, image, psnr
from lab.record import REPOSITORY, write_result
from lab.render import Camera, look_at, render

DATA = REPOSITORY / "tests" / "lab" / "render" / "data"
GSPLAT_REFERENCE = DATA / "gsplat_reference.npz"
SPLAT_TRANSFORM_REFERENCE = DATA / "splat_transform_playbot_31k.webp"
SPLAT = REPOSITORY / "assets" / "playbot_31k_sh2.ply"
#: the camera of splat-transform's image: eye and target, scene units; the splat's y points down
EYE, TARGET, UP = (1.52, -1.72, 1.21), (0.0, -0.5, 0.0), (0.0, -1.0, 0.0)
SIZE, VERTICAL_FOV = (320, 240), 50.0
_ARRAYS = ("positions", "rotations", "scales", "opacities", "sh_dc", "sh_rest")


def gsplat_errors() -> Iterator[np.ndarray]:
    """(pixels, 3): absolute differences of colour, of each view's pixels that are not on a threshold."""
    with np.load(GSPLAT_REFERENCE) as stored:
        data = dict(stored)
    cloud = GaussianCloud(*(data[name].astype(np.float32) for name in _ARRAYS))
    for view, lens, units, undecided in zip(
        data["world_to_camera"], data["intrinsics"], data["colour_units"], data["undecided"], strict=True
    ):
        camera = Camera(view, *lens.tolist(), *data["size"].tolist())
        found = render(cloud, camera, data["background"].tolist()).colour
        yield np.abs(found - units * float(data["unit"]))[~undecided]


def gsplat_unit() -> float:
    """Colour per unit of the stored 16-bit images; half of it is their rounding error."""
    with np.load(GSPLAT_REFERENCE) as stored:
        return float(stored["unit"])


def _gsplat() -> dict[str, Any]:
    with np.load(GSPLAT_REFERENCE) as stored:
        made_with = str(stored["made_with"])
    errors = [error.max() for error in gsplat_errors()]
    return {
        "made_with": made_with,
        "max_error_by_view": [float(error) for error in errors],
        "rounding_of_the_stored_image": gsplat_unit() / 2,
    }


def splat_transform_psnr() -> dict[str, float | None]:
    """dB over the pixels that our image covers, and over all."""
    expected = np.asarray(Image.open(SPLAT_TRANSFORM_REFERENCE).convert("RGB"), np.float32) / 255
    cloud, _ = read_ply(SPLAT)
    found = image(cloud, look_at(EYE, TARGET, SIZE, VERTICAL_FOV, UP))
    squares = (found.colour - expected) ** 2
    visible = squares[found.alpha > VISIBLE_ALPHA]
    return {"psnr": psnr(float(visible.mean())), "psnr_full_frame": psnr(float(squares.mean()))}


def main() -> None:
    """Compare and write the result."""
    results = {"gsplat": _gsplat(), "splat_transform": splat_transform_psnr()}
    for name, result in results.items():
        print(name, result)
    conditions = {
        "gsplat": "1500 Gaussians, SH degree 3, two views of 96x72, float64, all but undecided pixels",
        "splat_transform": f"2.7.1 on SwiftShader, {SPLAT.name} at {SIZE[0]}x{SIZE[1]}, 8 bits",
    }
    print(write_result("renderer", conditions, results))


if __name__ == "__main__":
    main()
