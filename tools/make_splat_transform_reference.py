"""A reference image for `lab.render` from splat-transform's WebGPU rasteriser.

    npm install @playcanvas/splat-transform@2.7.1
    python tools/make_splat_transform_reference.py node_modules/.bin/splat-transform

Without a GPU, a Vulkan driver on the processor serves: VK_ICD_FILENAMES names SwiftShader's.
"""

from __future__ import annotations

import subprocess
import sys

from lab.render_reference import EYE, SIZE, SPLAT, SPLAT_TRANSFORM_REFERENCE, TARGET, UP, VERTICAL_FOV


def _turned(vector: tuple[float, float, float]) -> str:
    """splat-transform shows a PLY turned by 180 degrees about z, and takes its camera in those axes."""
    x, y, z = vector
    return f"{-x:.9g},{-y:.9g},{z:.9g}"


def main(command: str) -> None:
    """Write the image: lossless, 8 bits."""
    view = {"camera": _turned(EYE), "look-at": _turned(TARGET), "up": _turned(UP)}
    view |= {"fov": f"{VERTICAL_FOV:g}", "resolution": f"{SIZE[0]}x{SIZE[1]}", "near": "0.01"}
    options = [f"--{name}={value}" for name, value in view.items()]
    target = str(SPLAT_TRANSFORM_REFERENCE)
    subprocess.run([command, "-q", "-w", "-g", "0", str(SPLAT), target, *options], check=True)


if __name__ == "__main__":
    main(sys.argv[1])
