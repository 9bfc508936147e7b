"""HTML pages of the program: one file each, from a template beside the code that fills it; all share page.html.j2."""

from __future__ import annotations

from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from bracket_ground.errors import InputError
from bracket_ground.files.files import whole_or_none


def rendered(template: Path, **values: object) -> str:
    """The page as text; whatever the template names must be there, and every text is escaped."""
    environment = Environment(
        loader=FileSystemLoader([template.parent, Path(__file__).parent]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(template.name).render(values)


def write_page(page: str, path: Path) -> int:
    """Write it; returns its size in bytes.

    Raises:
        InputError: it cannot be written.
    """
    content = page.encode()
    try:
        with whole_or_none(path) as partial:
            partial.write_bytes(content)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror or error}; choose another file") from None
    return len(content)
