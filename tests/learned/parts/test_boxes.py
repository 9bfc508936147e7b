"""Faster R-CNN's regions and boxes without torch: which are kept, and how a part stands that a box is around."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cell.interfaces.perception import Frame
from learned.inference.onnx_model import ModelCard
from learned.parts.boxes import HEAD_KIND, KIND, REGIONS, BoxPartDetector, boxed, surest_regions
from learned.parts.data import UNKNOWN
from learned.parts.maps import INPUT_PX
from tests.learned.parts.fakes import Scripted, pose_network
from tests.learned.parts.test_training import ABOVE, BENCH, PRODUCT, SCENES
