"""The simulator: a distribution of its own, found by its entry point; a cell of real devices needs none."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from bracket_cell.packages import SIMULATOR, how_to_install
from bracket_cell.remote.detecting import DetectByCamera
from bracket_ground.errors import InputError
from bracket_ground.files.model import Location, Model
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.devices import Devices
from bracket_ground.interfaces.product import Product

if TYPE_CHECKING:
    from bracket_cell.configuration import Configuration

ENTRY_POINTS = "cell.simulators"


class Drawn(Protocol):
    """From which seed, and for which goal, a world was drawn."""

    @property
    def seed(self) -> int: ...

    @property
    def goal(self) -> str: ...


class Simulator(Protocol):
    """Devices, worlds and files of a simulator; a module with these names is one."""

    Settings: type[Model]  # of the file that `devices: simulation:` names

    def changed(self, settings: Model, look: str | None = None, person: str | None = None, **others: bool) -> Model:
        """The settings with another look or person, or with other switches (`shift`, `overlap`); None leaves them.

        Raises:
            InputError: there is no such look or person, or its file is wrong.
        """
        ...

    def attachments(self, settings: Model, seed: int) -> dict[str, tuple[str, bytes]]:
        """Media type and content of the files that a log keeps of a simulated world, by name."""
        ...

    def look_name(self, settings: Model) -> str:
        """The name of the configured look."""
        ...

    def opened(
        self,
        configuration: Configuration,
        product: Product,
        seed: int,
        goal: str = "random",
        rendered: bool = True,
        detect: Callable[[], DetectByCamera] | None = None,
    ) -> Devices:
        """Open the simulated cell in this process.

        Args:
            rendered: draw what cameras see; without, hands, holes and parts come from the truth.
            detect: makes the detectors that run beside it, where frames are made beside it, too.

        Raises:
            CellError: it could not be opened.
        """
        ...

    def own_world(self, configuration: Configuration, product: Product, seed: int, goal: str) -> Devices:
        """Open a world in a process of its own, on the wall's time, that ends with this one.

        Raises:
            CellError: it could not be opened.
        """
        ...

    def connected(self, configuration: Configuration, product: Product, address: Path, pace: Any) -> Devices:
        """Take over the devices of a world at an address.

        Raises:
            InputError: no world is there, or it does not accept such a controller.
        """
        ...

    def is_there(self, address: Path) -> bool:
        """Whether a world answers at an address."""
        ...

    def drawn_from(self, address: Path) -> Drawn:
        """What the world at an address was drawn from.

        Raises:
            InputError: no world is there, or it does not say.
        """
        ...

    def overlapping(self, product: Product, bench: Bench) -> list[tuple[Location, str]]:
        """Things of a bench that would stand in each other's place, each with its place in the configuration."""
        ...

    def rendering(self) -> tuple[str, str]:
        """The name of what renders here, and what to do where nothing does; empty where all is well."""
        ...

    def injected(self, text: str, joints: int) -> Any:
        """Faults to put into a run (a `running.inference.FaultInjection`), from FAULT@STATE[,FAULT@STATE...].

        Args:
            joints: how many the arm has.

        Raises:
            InputError: there is no such fault or state.
        """
        ...

    def missing_library(self, error: Exception) -> str | None:
        """Why nothing renders, where an error came out of a graphics library; None for other errors."""
        ...

    def schemas(self) -> Mapping[str, dict[str, Any]]:
        """JSON schemas of the simulator's files, by name."""
        ...


class NoSimulation(Model):
    """Settings where no simulator is installed."""


@cache
def installed() -> Simulator | None:
    """The simulator of this environment, or None."""
    found = entry_points(group=ENTRY_POINTS)
    return next(iter(found)).load() if found else None


def simulator() -> Simulator:
    """The simulator of this environment.

    Raises:
        InputError: none is installed.
    """
    if (found := installed()) is None:
        raise InputError(f"no simulator is installed; install it: {how_to_install(SIMULATOR)}")
    return found
