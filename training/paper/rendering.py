"""The paper's render loss, 0.8 L1 + 0.2 (1 - SSIM) on one camera, of a GoF in closed loop with refinement."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from dfcgs_codec.transform.companding import expand
from lab.render.autograd import render_tensors, ssim_tensors
from lab.render.camera import Camera
from training.paper.coding import Coded, code_frame, frame_prior
from training.paper.gof import Gof
from training.paper.nets import PaperModel
from training.paper.samples import Sample, sample_of

SSIM_WEIGHT = 0.2
#: columns of `Sample.look` before SH above degree 0
_REST = 7


@dataclass(frozen=True, eq=False)
class Stage:
    """A GoF that can be rendered: all Gaussians, and what rendering needs besides positions and rotations."""

    sample: Sample
    gof: Gof
    scales: Tensor
    opacities: Tensor
    sh_dc: Tensor

    @staticmethod
    def of(gof: Gof) -> Stage:
        """Of a prepared GoF."""
        _, scale, opacity, colour = (int(unit) for unit in gof.units)
        logits = expand(gof.opacities[:, 0].astype(np.int64), opacity) * 2.0**opacity
        return Stage(
            sample_of(gof, everyone=True),
            gof,
            torch.from_numpy((gof.scales * 2.0**scale).astype(np.float32)),
            torch.from_numpy(logits.astype(np.float32)),
            torch.from_numpy((gof.colours[:, :3] * 2.0**colour).astype(np.float32)),
        )

    @property
    def num_rest(self) -> int:
        """Columns of SH above degree 0."""
        return self.gof.colours.shape[1] - 3

    def picture(self, positions: Tensor, rotations: Tensor, look: Tensor, camera: Camera) -> Tensor:
        """(H, W, 3) of normalised positions, rotations and the SH in `look`."""
        unit = 2.0**self.gof.log2_unit
        centre = torch.from_numpy(self.gof.centre * 2.0 ** int(self.gof.units[0])).float()
        rest = look[:, _REST : _REST + self.num_rest].reshape(len(look), -1, 3).transpose(1, 2)
        cloud = (positions * unit + centre, rotations, self.scales, self.opacities, self.sh_dc)
        return render_tensors([*(t.contiguous() for t in cloud), rest.contiguous()], camera)[0]


def picture_loss(picture: Tensor, target: Tensor) -> Tensor:
    """0.8 L1 + 0.2 (1 - SSIM)."""
    similarity = ssim_tensors(picture.contiguous(), target)
    return (1 - SSIM_WEIGHT) * (picture - target).abs().mean() + SSIM_WEIGHT * (1 - similarity)


@dataclass(frozen=True, eq=False)
class Rendered:
    """A coded P-frame and its picture, with losses of that, of the reference's, and without refinement."""

    coded: Coded
    reference: tuple[Tensor, Tensor]
    picture: Tensor
    target: Tensor
    loss: Tensor
    repeated: Tensor
    unrefined: Tensor


def refined(model: PaperModel, stage: Stage, reference: tuple[Tensor, Tensor], look: Tensor) -> Tensor:
    """`look` with the colours of the next frame: colour refinement from the priors of all Gaussians."""
    if not model.has("refinement") or not stage.num_rest:
        return look
    residual = model.nets["refinement"](frame_prior(model, *reference, look))[:, : stage.num_rest]
    end = _REST + stage.num_rest
    return torch.cat([look[:, :_REST], look[:, _REST:end] + residual, look[:, end:]], dim=1)


def rendered_loop(
    model: PaperModel, stage: Stage, step: Tensor, view: int, *, refine: bool = True
) -> Iterator[tuple[int, Rendered]]:
    """The closed loop of a GoF with pictures of one camera."""
    camera, sample = stage.gof.camera(view), stage.sample
    look = sample.look
    reference = sample.positions[0], sample.rotations[0]
    with torch.no_grad():
        before = stage.picture(*reference, look, camera)
    for frame in range(1, len(sample.positions)):
        target = torch.from_numpy(stage.gof.images[view, frame - 1].astype(np.float32))
        current = replace(sample, look=look)
        coded = code_frame(model, current, frame, reference, step.expand(len(sample.control), 1))
        new_look = refined(model, stage, reference, look) if refine else look
        picture = stage.picture(coded.positions, coded.rotations, new_look, camera)
        with torch.no_grad():
            plain = picture
            if new_look is not look:
                plain = stage.picture(coded.positions, coded.rotations, look, camera)
            losses = [picture_loss(image, target) for image in (before, plain)]
        yield frame, Rendered(coded, reference, picture, target, picture_loss(picture, target), *losses)
        look, before = new_look.detach(), picture.detach()
        reference = coded.positions.detach(), coded.rotations.detach()


def _psnr(squares: list[Tensor]) -> float:
    return float(-10 * torch.log10(torch.stack(squares).mean()))


def picture_figures(model: PaperModel, gof: Gof, step: float) -> dict[str, float]:
    """PSNR (dB) of pictures of a GoF's P-frames, coded with and without refinement, and of its I-frame."""
    stage = Stage.of(gof)
    squares: dict[str, list[Tensor]] = {"refined": [], "unrefined": [], "repeated": []}
    with torch.no_grad():
        for view in range(len(gof.images)):
            still = stage.picture(
                stage.sample.positions[0], stage.sample.rotations[0], stage.sample.look, gof.camera(view)
            )
            for name, refine in (("refined", True), ("unrefined", False)):
                for _, frame in rendered_loop(model.eval(), stage, torch.tensor([step]), view, refine=refine):
                    squares[name].append((frame.picture - frame.target).square().mean())
                    if refine:
                        squares["repeated"].append((still - frame.target).square().mean())
    return {f"psnr_{name}": round(_psnr(values), 3) for name, values in squares.items()}
