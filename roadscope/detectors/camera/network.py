"""A small one-stage detector without anchors: a centre heatmap and distances to the four sides.

Zhou 2019 (objects as points) for the heatmap, Tian 2019 (FCOS) for the distances. Plain 3 x 3
convolutions: on a processor depthwise ones save nothing.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

from roadscope.detectors.camera.decoding import FINE, LARGEST, UNIT_PX

ARCHITECTURE = "roadscope-centre-3"
"""Name of the architecture; it changes when old weights no longer fit the network."""
FAMILY_COUNT = 3
VEHICLE_COUNT = 5
"""Categories of the family vehicle; the other families have one each."""
SQUARE = 2
"""The first convolution takes squares of 2 x 2 pixels as one position (space to depth)."""
RARE = -6.0
"""Log odds of a centre before training: one position in four hundred."""
STEM = 16
"""Channels behind the first convolution."""
WIDTHS = (32, 64, 96, 96)
"""Channels of the stages; multiples of 32, which processors with bfloat16 multiply in pairs."""
DEPTHS = (2, 2, 2, 1)
"""Residual blocks of the stages."""
NECK = 32
HEAD = 48
"""Channels of the feature pyramid and of the head."""


class Maps(NamedTuple):
    """The network's outputs at every second pixel.

    heat: (B, 3, h, w) log odds of the centre of one of each family.
    distances: (B, 4, h, w) to the left, top, right and bottom of the box, pixels.
    vehicles: (B, 5, h, w) log odds among the categories of vehicles.
    """

    heat: Tensor
    distances: Tensor
    vehicles: Tensor


def squares(pixels: Tensor) -> Tensor:
    """Turn (B, H, W, 3) into (B, 12, H / 2, W / 2), channels last in memory (space to depth)."""
    count, height, width, _ = pixels.shape
    parts = pixels.reshape(count, height // SQUARE, SQUARE, width // SQUARE, SQUARE * 3)
    return parts.transpose(2, 3).flatten(3).permute(0, 3, 1, 2)


def finer(answers: Tensor) -> Tensor:
    """Turn (B, h, w, 4 C) into (B, C, 2 h, 2 w), four parts of a position row by row.

    This is depth to space, the pixel shuffle of Shi 2016.
    """
    count, height, width, _ = answers.shape
    split = answers.reshape(count, height, width, FINE, FINE, -1)
    return split.permute(0, 5, 1, 3, 2, 4).reshape(count, -1, FINE * height, FINE * width)


class Convolution(nn.Module):
    """3 x 3 convolution, batch norm and, unless it ends a block, ReLU."""

    def __init__(self, ins: int, outs: int, stride: int = 1, *, rectify: bool = True) -> None:
        super().__init__()
        self.conv = nn.Conv2d(ins, outs, 3, stride, 1, bias=False)
        self.norm: nn.Module = nn.BatchNorm2d(outs)
        self.rectify = rectify

    def forward(self, x: Tensor) -> Tensor:
        """Map (B, ins, h, w) to (B, outs, h / stride, w / stride)."""
        y: Tensor = self.norm(self.conv(x))
        return functional.relu_(y) if self.rectify else y

    def fold(self) -> None:
        """Merge the batch norm into the convolution; for inference only."""
        if isinstance(self.norm, nn.BatchNorm2d):
            self.conv = nn.utils.fuse_conv_bn_eval(self.conv.eval(), self.norm.eval())
            self.norm = nn.Identity()


class Residual(nn.Module):
    """Two convolutions and a shortcut past them (He 2016)."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.first = Convolution(width, width)
        self.second = Convolution(width, width, rectify=False)

    def forward(self, x: Tensor) -> Tensor:
        """Map (B, C, h, w) to the same shape."""
        return functional.relu_(x + self.second(self.first(x)))


class CentreNetwork(nn.Module):
    """A backbone with strides from 2 to 32, a feature pyramid up to 4 (Lin 2017), and one head.

    The head has outputs for four parts of each of its positions (sub-pixel convolution, Shi 2016).
    """

    def __init__(self) -> None:
        super().__init__()
        self.stem = Convolution(3 * SQUARE**2, STEM)
        ins = STEM
        stages = []
        for width, depth in zip(WIDTHS, DEPTHS, strict=True):
            blocks = (Residual(width) for _ in range(depth))
            stages.append(nn.Sequential(Convolution(ins, width, 2), *blocks))
            ins = width
        self.stages = nn.ModuleList(stages)
        self.lateral = nn.ModuleList(nn.Conv2d(width, NECK, 1) for width in WIDTHS)
        self.head = Convolution(NECK, HEAD)
        # The same as a 1 x 1 convolution, whose gradient is slower to compute.
        self.out = nn.Linear(HEAD, FINE**2 * (FAMILY_COUNT + 4 + VEHICLE_COUNT))
        nn.init.normal_(self.out.weight, std=0.01)
        offsets = torch.tensor([RARE] * FAMILY_COUNT + [1.0] * 4 + [0.0] * VEHICLE_COUNT)
        self.out.bias = nn.Parameter(offsets.repeat(FINE**2))

    def forward(self, pixels: Tensor) -> Maps:
        """Return the maps of (B, H, W, 3) colours in -1 to 1; H and W are multiples of 32."""
        maps = finer(self.answers(squares(pixels)))
        heat, sides, vehicles = torch.split(maps, [FAMILY_COUNT, 4, VEHICLE_COUNT], dim=1)
        return Maps(heat, UNIT_PX * sides.clamp(max=LARGEST).exp(), vehicles)

    def answers(self, places: Tensor) -> Tensor:
        """Return (B, h, w, 48) float32 outputs for `squares` of colours: 12 for each of 4 parts."""
        x = self.stem(places)
        features = []
        for stage in self.stages:
            x = stage(x)
            features.append(x)
        y = self.lateral[-1](features[-1])
        for k in range(len(features) - 2, -1, -1):
            y = self.lateral[k](features[k]) + functional.interpolate(
                y, scale_factor=2.0, mode="nearest"
            )
        # Boxes need more digits than bfloat16 has, so the last layer is always float32.
        last = self.head(functional.relu_(y))
        with torch.autocast(places.device.type, enabled=False):
            answers: Tensor = self.out(last.permute(0, 2, 3, 1).float())
        return answers

    def folded(self, dtype: torch.dtype = torch.float32) -> CentreNetwork:
        """Return a copy for inference: no batch norm, channels last, the given dtype.

        The last layer stays in float32.
        """
        copy = CentreNetwork()
        copy.load_state_dict(self.state_dict())
        copy.eval()
        for module in copy.modules():
            if isinstance(module, Convolution):
                module.fold()
        channels_last(copy.to(dtype)).out.float()
        return copy.requires_grad_(False)


def channels_last(network: CentreNetwork) -> CentreNetwork:
    """Store the weights of convolutions channels last, in place, as fast kernels need them."""
    with torch.no_grad():
        for weight in network.parameters():
            if weight.ndim == 4:
                weight.data = weight.data.contiguous(memory_format=torch.channels_last)
    return network
