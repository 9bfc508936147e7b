"""Tests; they run in a clone."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
