"""Equal to the bit over runs, thread counts and processes."""

from __future__ import annotations

import hashlib
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("numba", reason="the renderer is compiled by numba, from the eval extra")

from lab.render import orbit, render, render_backward, ssim_with_gradient
from tests.lab.render.render_scenes import random_cloud

ROOT = Path(__file__).parents[3]


def digest(threads: int) -> str:
    """A hash of image, gradients and SSIM of a scene with more Gaussians and tiles than one piece of work."""
    cloud = random_cloud(9000, 2, 5)
    rendering = render(cloud, orbit((0, 0, 0), 3.0, (30, 20), (160, 120)), (0.1, 0.2, 0.3), threads)
    score, gradient = ssim_with_gradient(rendering.colour, np.full((120, 160, 3), 0.5, np.float32), threads)
    arrays = render_backward(rendering, gradient, rendering.alpha, threads)
    state = hashlib.sha256(np.float64(score).tobytes())
    for array in (rendering.colour, rendering.alpha, gradient, *arrays):
        state.update(array.tobytes())
    return state.hexdigest()


def test_threads_and_runs_do_not_matter():
    assert len({digest(threads) for threads in (1, 2, 3, 7, 2, 1)}) == 1


def _run(command: str, root: Path) -> str:
    program = f"import sys; sys.path[:0] = {[str(root), str(ROOT), str(ROOT / 'src')]!r}; {command}"
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    return result.stdout.split()[-1]


def test_another_process_gives_the_same_bits():
    command = "from tests.lab.render.test_render_determinism import digest; print(digest(2))"
    assert _run(command, ROOT) == digest(1)


@pytest.mark.slow
def test_compiled_code_follows_a_change_of_another_file(tmp_path):
    """A constant is compiled into the kernels of other files; numba's own cache would keep the old one."""
    package = tmp_path / "lab" / "render"
    shutil.copytree(ROOT / "lab" / "render", package, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "lab" / "__init__.py", tmp_path / "lab")
    command = (
        "from tests.lab.render.render_scenes import forward_camera, plain_cloud; "
        "from lab.render import render; "
        "print(render(plain_cloud([[0, 0, 2]], [[1, 1, 1]], [0.9999], [1]), forward_camera()).alpha.max())"
    )
    assert _run(command, tmp_path) == "0.999"
    constants = package / "constants.py"
    constants.write_text(constants.read_text().replace("ALPHA_CAP = 0.999", "ALPHA_CAP = 0.25"))
    assert _run(command, tmp_path) == "0.25"
