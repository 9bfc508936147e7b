"""A product family as text and as a picture: its AND/OR graph (which goals, and all slots of each), and its precedence.

After Homem de Mello and Sanderson (1990): one of the goals (OR), and of each all its steps (AND).
"""

from __future__ import annotations

from collections.abc import Iterator
from xml.sax.saxutils import escape

from bracket_cell.viewing.guidance import step_words
from bracket_ground.interfaces.product import Product
from bracket_ground.interfaces.steps import in_order

WIDTH_PX, HEIGHT_PX, GAP_PX, ROOM_PX = 190, 44, 14, 70  # of a box, and between boxes and columns
LETTERS = 29  # that a box's width holds
STYLE = (
    "text{font:12px sans-serif;fill:#222}.s{font-size:10px;fill:#555}rect{fill:#fff;stroke:#555}"
    "rect.goal{fill:#e8eef7}rect.fastening{fill:#f7efe0}path{fill:none;stroke:#777}.or{stroke-dasharray:4 3}"
)
ARROW = (
    '<marker id="to" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="7" markerHeight="7" orient="auto">'
    '<path d="M0 0L8 4L0 8z" style="fill:#777"/></marker>'
)


def product_text(product: Product) -> str:
    """Goals with their steps, each step in an order that precedence allows."""
    lines = [f"{product.name}: one of {len(product.goals)} goals"]
    for goal in product.goals:
        title = product.goal_title(goal)
        lines += [f"  {goal}" + (f" ({title})" if title != goal else "") + ": all of"]
        for step in product.steps(goal):
            first = product.missing_before(step, (), product.accepted(goal))
            after = f", after {', '.join(sorted(first))}" if first else ""
            lines.append(f"    {step}: {_words(product, step, goal)}{after}")
    return "\n".join(lines) + "\n"


def product_picture(product: Product) -> str:
    """SVG of both graphs: goals on the left with dashed lines, then steps, an arrow for each "before"."""
    steps = in_order([*product.positions, *product.fastenings], product.predecessors)
    level: dict[str, int] = {}
    for step in steps:
        level[step] = 1 + max((level[predecessor] for predecessor in product.predecessors[step]), default=1)
    columns: dict[int, list[str]] = {0: [""], 1: list(product.goals)}
    for step in steps:
        columns.setdefault(level[step], []).append(step)
    at = {name: place for column, names in columns.items() for name, place in _column(column, names)}
    height = max(y for _, y in at.values()) + HEIGHT_PX + GAP_PX
    width = max(x for x, _ in at.values()) + WIDTH_PX + GAP_PX
    drawn = [*_lines(product, at), *_boxes(product, columns, at)]
    head = f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" viewBox="0 0 {width} {height}">'
    return "\n".join([head, f"<style>{STYLE}</style><defs>{ARROW}</defs>", *drawn, "</svg>\n"])


def _column(column: int, names: list[str]) -> Iterator[tuple[str, tuple[int, int]]]:
    for row, name in enumerate(names):
        yield name, (GAP_PX + column * (WIDTH_PX + ROOM_PX), GAP_PX + row * (HEIGHT_PX + GAP_PX))


def _lines(product: Product, at: dict[str, tuple[int, int]]) -> Iterator[str]:
    for goal in product.goals:
        yield _line(at[""], at[goal], "or")
        for step in product.steps(goal):
            if not product.missing_before(step, (), product.accepted(goal)):
                yield _line(at[goal], at[step], "or")
    for step, before in product.predecessors.items():
        for first in sorted(before):
            yield _line(at[first], at[step], "and")


def _line(start: tuple[int, int], end: tuple[int, int], kind: str) -> str:
    (x, y), (x2, y2) = (start[0] + WIDTH_PX, start[1] + HEIGHT_PX // 2), (end[0], end[1] + HEIGHT_PX // 2)
    middle = (x + x2) / 2
    arrow = ' marker-end="url(#to)"' if kind == "and" else ""
    return f'<path class="{kind}" d="M{x} {y}C{middle} {y} {middle} {y2} {x2} {y2}"{arrow}/>'


def _boxes(product: Product, columns: dict[int, list[str]], at: dict[str, tuple[int, int]]) -> Iterator[str]:
    for column, names in columns.items():
        for name in names:
            if column == 0:
                yield _box(at[name], "goal", product.name, "one of these (OR)")
            elif column == 1:
                yield _box(at[name], "goal", product.goal_title(name), "all of these (AND)")
            else:
                kind = "fastening" if name in product.fastenings else "slot"
                yield _box(at[name], kind, name, _words(product, name))


def _box(at: tuple[int, int], kind: str, title: str, words: str) -> str:
    x, y = at
    words = words if len(words) <= LETTERS else f"{words[: LETTERS - 1]}…"
    return (
        f'<rect class="{kind}" x="{x}" y="{y}" width="{WIDTH_PX}" height="{HEIGHT_PX}" rx="5"/>'
        f'<text x="{x + 8}" y="{y + 18}">{escape(title)}</text>'
        f'<text class="s" x="{x + 8}" y="{y + 34}">{escape(words)}</text>'
    )


def _words(product: Product, step: str, goal: str | None = None) -> str:
    """What is done in a step; without a goal the part types of all of them."""
    if step in product.fastenings:
        return step_words(product, step)
    goals = product.goals if goal is None else [goal]
    types = dict.fromkeys(part for name in goals for part in product.accepted(name).get(step, ()))
    wholes = [product.wholes[part] for part in types if part in product.wholes]
    built = [f", built at {kind.built_at} of {', '.join(kind.made_of)}" for kind in wholes]
    return " or ".join(product.title(part) if goal else part for part in types) + "".join(built)
