"""A folder of stacks in whichever format it is."""

from __future__ import annotations

from pathlib import Path

from bracket_ground.errors import InputError, Place, Problem
from bracket_lab.experiments.stacks.checks import StackData
from bracket_lab.experiments.stacks.regrad import is_regrad, read_regrad
from bracket_lab.experiments.stacks.vmrd import SPLITS, read_vmrd


def read_stacks(folder: Path) -> StackData:
    """Read a folder of VMRD, or of REGRAD V1 or V2.

    Raises:
        InputError: it is none of these, or something is wrong in it.
    """
    if (folder / SPLITS).is_dir():
        return read_vmrd(folder)
    if is_regrad(folder):
        return read_regrad(folder)
    legal = f"{SPLITS} (VMRD), or train and test (REGRAD); `cell lab data stacks` writes the former"
    raise InputError(Problem(Place(folder), "no folder of stacks", legal))
