"""The plan in sentences: where each type of part still goes, what is done, and what must be there before."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping

from bracket_ground.files.words.message import Message, listed
from bracket_ground.interfaces.product import Product


def guidance_sentences(
    guidance: Mapping[str, tuple[str, ...]],
    any_part: tuple[str, ...] = (),
    product: Product | None = None,
    done: Collection[str] = (),
    built: Collection[str] = (),
) -> list[str]:
    """Sentences about what remains; each can be translated.

    Args:
        guidance: by part type, the positions that remain for it in all likely goals, in order.
        any_part: the positions for which these goals want different parts.
        product: says what comes before what.
        done: filled positions and finished fastenings.
        built: sub-assemblies that stand ready.
    """
    title = str if product is None else product.title
    sentences: list[str] = []
    right: dict[tuple[str, ...], list[str]] = {}  # positions by all types that are right there
    for at in dict.fromkeys(at for to in guidance.values() for at in to):
        right.setdefault(tuple(part for part, to in guidance.items() if at in to), []).append(at)
    for part, positions in guidance.items():
        if not positions and (product is None or product.most[part]):
            sentences.append(Message("No {part} is left to place", part=title(part)))
        for types, holes in right.items():
            if types[0] == part:
                either = one_of([*map(title, types)])
                sentences.append(Message("The {part} goes into {holes}", part=either, holes=all_of(holes)))
        if product is not None and positions and part in product.wholes and part not in built:
            sentences.append(build_words(product, part, title))
    if any_part:
        sentences.append(Message("What goes into {holes} is not sure yet", holes=all_of(any_part)))
    shown = {position for to in (*guidance.values(), any_part) for position in to}
    return sentences if product is None else [*sentences, *_order(product, shown | set(done), done)]


def _order(product: Product, filled: Collection[str], done: Collection[str]) -> Iterator[str]:
    """What comes before what of the steps that remain, and fastenings whose turn it is."""
    for step in product.steps_of(filled):
        first = [] if step in done else product.missing_before(step, done, filled)
        if first and step in product.positions:
            steps = all_of([step_words(product, part) for part in first])
            yield Message("Before {step} comes {first}", step=step, first=steps)
        elif not first and step in product.fastenings and step not in done:
            yield Message("Now {step}", step=step_words(product, step))


def build_words(product: Product, part: str, title: Callable[[str], str]) -> str:
    """Where a sub-assembly is built and of what, for people."""
    place, parts = product.wholes[part].built_at, all_of([*map(title, product.wholes[part].made_of)])
    return Message("Build the {part} at {place} of {parts}", part=title(part), place=place, parts=parts)


def step_words(product: Product, step: str) -> str:
    """A placement or a fastening, for people."""
    if step not in product.fastenings:
        return step
    fastening = product.fastenings[step]
    title, at = fastening.title or fastening.how, all_of(fastening.at)
    if fastening.torque_nm is None:
        return Message("{title} at {holes}", title=title, holes=at)
    return Message("{title} at {holes} to {torque} Nm", title=title, holes=at, torque=f"{fastening.torque_nm:g}")


def one_of(names: Collection[str]) -> str:
    """Names with "or" before the last; each is translated."""
    *first, last = names or [""]
    return Message("{first} or {last}", first=listed(first, ", "), last=last) if first else last


def all_of(names: Collection[str]) -> str:
    """Names with "and" before the last."""
    *first, last = names
    return Message("{first} and {last}", first=listed(first, ", "), last=last) if first else last
