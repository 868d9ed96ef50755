"""The picture of the README: `python -m evaluation.picture` writes `docs/picture.webp`.

The last of ten frames of a stored capture, rendered from a place between its cameras: the input, what is
decoded at three presets, and at two of them when the encoder is told where the cameras stood. Beneath each
stand the bytes per frame of the whole file on disk, and the PSNR of this image against that of the input.
"""

from __future__ import annotations

import tempfile
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from dfcgs_codec import EncoderOptions, GaussianCloud, decode_sequence, encode_sequence
from dfcgs_codec.ply import write_ply
from lab import quality
from lab.assets import find_asset
from lab.captures.files import cameras_file
from lab.record import REPOSITORY
from lab.render import Camera
from lab.scenes.catalogue import scene
from lab.views import cameras

PICTURE = REPOSITORY / "docs" / "picture.webp"
SCENE, VIEW, NUM_FRAMES = "kitchen_capture", 3, 10
#: caption and options of each decoded panel
CODED = {
    "low": EncoderOptions(quality="low"),
    "medium": EncoderOptions(quality="medium"),
    "high": EncoderOptions(quality="high"),
    "low, told its cameras": EncoderOptions(quality="low", views=cameras_file(SCENE)),
    "medium, told its cameras": EncoderOptions(quality="medium", views=cameras_file(SCENE)),
}
#: of the panels; height of the line beneath one and size of its letters, pixels
COLUMNS, WIDTH, LINE, LETTERS = 3, 400, 26, 15

Panel = tuple[quality.Image, str]


def _camera() -> Camera:
    """The view of the evaluation, in an image of WIDTH pixels."""
    (camera,) = cameras(SCENE, (VIEW,))
    scale = WIDTH / camera.width
    lens = {name: getattr(camera, name) * scale for name in ("fx", "fy", "cx", "cy")}
    return replace(camera, **lens, width=WIDTH, height=round(camera.height * scale))


def _ply_bytes(cloud: GaussianCloud, path: Path) -> int:
    write_ply(path, cloud)
    return path.stat().st_size


def _decoded(frames: list[GaussianCloud], path: Path, options: EncoderOptions) -> tuple[GaussianCloud, float]:
    """The last frame after coding, and kB per frame of the whole file."""
    encode_sequence(frames, path, options, force=True)
    (*_, last) = (frame.cloud() for frame in decode_sequence(path))
    return last, path.stat().st_size / 1000 / len(frames)


def panels(folder: Path) -> list[Panel]:
    """The input and every entry of CODED, each with its caption."""
    camera, chosen = _camera(), scene(SCENE)
    frames = list(islice(chosen.frames(find_asset(chosen.asset)), NUM_FRAMES))
    source = quality.image(frames[-1], camera)
    result = [(source, f"input: {_ply_bytes(frames[-1], folder / 'frame.ply') / 1000:.0f} kB")]
    for name, options in CODED.items():
        cloud, kilobytes = _decoded(frames, folder / "out.dgs", options)
        image = quality.image(cloud, camera)
        psnr = quality.psnr(float(np.mean((image.colour - source.colour) ** 2)))
        result.append((image, f"{name}: {kilobytes:.1f} kB, {psnr:.1f} dB"))
        print(result[-1][1], flush=True)
    return result


def drawn(shown: list[Panel]) -> Image.Image:
    """All panels on one sheet, row by row."""
    height = shown[0][0].colour.shape[0] + LINE
    sheet = Image.new("RGB", (WIDTH * COLUMNS, height * -(-len(shown) // COLUMNS)), "white")
    pen, letters = ImageDraw.Draw(sheet), ImageFont.load_default(LETTERS)
    for place, (image, caption) in enumerate(shown):
        x, y = WIDTH * (place % COLUMNS), height * (place // COLUMNS)
        sheet.paste(Image.fromarray(np.round(image.colour * 255).astype(np.uint8)), (x, y))
        pen.text((x + 6, y + height - LINE + 4), caption, "black", font=letters)
    return sheet


def main() -> None:
    """Encode, decode, render, write."""
    with tempfile.TemporaryDirectory() as folder:
        drawn(panels(Path(folder))).save(PICTURE, quality=93, method=6)


if __name__ == "__main__":
    main()
