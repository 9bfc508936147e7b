"""What MkDocs asks while it builds the site: generated pages are in the nav, files outside of docs/ come along."""

from __future__ import annotations

import re
from os.path import normpath
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parents[2]
LINK = re.compile(r"\]\((?!\w+:)([^)#]+)(#[^)]*)?\)")
LISTED = re.compile(r"[\w/-]+/\*\.md")  # an entry of the nav


def on_config(config: Any) -> Any:
    """`folder/*.md` in the nav stands for the pages of that folder."""
    config.nav = [_expanded(entry, Path(config.docs_dir)) for entry in config.nav]
    return config


def on_files(files: Files, config: Any) -> Files:
    """Every file that a page links to outside of docs/: pages at the top, others under files/."""
    for page in list(files.documentation_pages()):
        for link, _ in LINK.findall(page.content_string):
            name = _outside(page, link)
            if name is not None and files.get_file_from_path(_place(name)) is None:
                files.append(File.generated(config, _place(name), abs_src_path=str(ROOT / name)))
    files.append(File.generated(config, "llms.txt", content=overview(config)))
    return files


def overview(config: Any) -> str:
    """All pages with their titles for a language model, as llmstxt.org has it."""
    lines = [f"# {config.site_name}", "", f"> {config.site_description}"]
    for section in config.nav:
        for title, entries in section.items():
            lines += ["", f"## {title}", "", *_listed(entries)]
    return "\n".join(lines) + "\n"


def _listed(entries: list[Any]) -> list[str]:
    lines: list[str] = []
    for entry in entries:
        title, inner = next(iter(entry.items())) if isinstance(entry, dict) else (Path(entry).stem, entry)
        lines += _listed(inner) if isinstance(inner, list) else [f"- [{title}]({_address(inner)})"]
    return lines


def on_page_markdown(markdown: str, page: Any, config: Any, files: Files) -> str:  # noqa: ARG001
    """Links lead to those files, from wherever the page is."""
    if page.file.generated_by is not None:  # it stood at the top
        return re.sub(r"\]\(docs/", "](", markdown)
    up = "../" * page.file.src_uri.count("/")

    def led(link: re.Match[str]) -> str:
        name = _outside(page.file, link[1])
        return link[0] if name is None else f"]({up}{_place(name)}{link[2] or ''})"

    return LINK.sub(led, markdown)


def _address(page: str) -> str:
    return "index.html" if page == "README.md" else f"{page.removesuffix('.md')}.html"


def _outside(page: File, link: str) -> str | None:
    """The path in the project of a file outside of docs/ that a page links to; None for all others."""
    target = Path(normpath(Path("docs", page.src_uri).parent / link))
    return None if target.parts[0] == "docs" or not (ROOT / target).is_file() else target.as_posix()


def _place(name: str) -> str:
    return name if name.endswith(".md") and "/" not in name else f"files/{name}"


def _expanded(entry: Any, docs: Path) -> Any:
    if isinstance(entry, dict):
        return {title: _expanded(inner, docs) for title, inner in entry.items()}
    if isinstance(entry, list):
        return [each for inner in entry for each in _pages(inner, docs)]
    return entry


def _pages(entry: Any, docs: Path) -> list[Any]:
    if isinstance(entry, str) and LISTED.fullmatch(entry):
        return [path.relative_to(docs).as_posix() for path in sorted(docs.glob(entry))]
    return [_expanded(entry, docs)]
