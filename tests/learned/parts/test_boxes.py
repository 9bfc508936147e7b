"""Faster R-CNN's regions and boxes without torch: which are kept, and how a part stands that a box is around."""

from __future__ import annotations
