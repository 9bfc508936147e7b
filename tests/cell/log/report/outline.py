"""What a page of HTML has, for tests."""

from __future__ import annotations

from html.parser import HTMLParser

VOID = {"meta", "link", "br", "img", "hr", "input"}


class Outline(HTMLParser):
    """Checks that tags close in order and rows of a table have equal lengths; keeps ids, addresses and text."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.ids: list[str] = []
        self.addresses: list[str] = []
        self.text: list[str] = []
        self.rows: list[int] = []  # cells of each row of the table that is open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = dict(attrs)
        self.ids += [values["id"] or ""] if "id" in values else []
        self.addresses += [value or "" for name, value in attrs if name in ("href", "src", "xlink:href", "action")]
        if tag == "tr":
            self.rows.append(0)
        elif tag in ("td", "th"):
            self.rows[-1] += int(values.get("colspan") or 1)
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag
        if tag == "table":
            assert len(set(self.rows)) <= 1, f"line {self.getpos()[0]}: a table's rows have {self.rows} cells"
            self.rows = []

    def handle_data(self, data: str) -> None:
        self.text.append(data)


def outline_of(page: str) -> Outline:
    """What a page has.

    Raises:
        AssertionError: a tag does not close, or a table has a header without a cell.
    """
    parsed = Outline()
    parsed.feed(page)
    assert parsed.open == []
    return parsed
