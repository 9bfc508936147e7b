"""What a log says, in lines for people at a terminal; `--json` has the same in full."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from typing import Any

from bracket_cell.log.replay.compare import Difference, causes_in
from bracket_ground.errors import counted
from btxml.engine.node import StatusChange
from btxml.engine.why import Step

LONGEST_LIST = 8
LONGEST_TEXT = 160
MOST_FIELDS = 4  # of a difference
FIGURES = 4
ABSENT, NOTHING = "not there", "nothing"
LONGEST_PAIR = 70
NOTES = ("belief", "plan", "verdict", "help", "skill")
COMMANDS = {"stop_arm": "stop the arm", "look": "wrist camera looks", "activate_gripper": "activate the gripper"}


def short(value: object, longest: int = LONGEST_TEXT) -> str:
    """A value with few figures, without the middle of long lists, in one line."""
    text = value if isinstance(value, str) else json.dumps(_brief(value), ensure_ascii=False)
    return text if len(text) <= longest else f"{text[: longest - 1]}…"


def entry_text(entry: Mapping[str, Any], longest: int = LONGEST_TEXT) -> str:
    """An answer of `cell log query` in a line: a change of a node's status, or a message."""
    head = f"{entry['time_s']:8.2f} s  "
    if "topic" in entry:
        fields = {key: value for key, value in entry.items() if key not in ("topic", "time_s")}
        text = note_text("help", fields) if entry["topic"] == "/note/help" else short(fields, longest)
        return head + short(f"{entry['topic']}  {text}", longest)
    return f"{head}{entry['path']}: {entry['old']} > {entry['new']}  {entry['feedback']}".rstrip()


def note_text(topic: str, fields: Mapping[str, Any]) -> str:
    """A note of a node."""
    for (of, needed), (head, template) in NOTE_TEXTS.items():
        if of == topic and (not needed or needed in fields):
            with suppress(KeyError, ValueError, TypeError, AttributeError):  # else as it is
                return f"{head:10} {template(fields)}"
    return f"{topic:10} {short(fields)}"


def _placed(fields: Mapping[str, Any]) -> str:
    part, position = fields["edge"]
    return f"{part or 'nothing'} at {position}, known from: {fields.get('source', '')}"


def _stays(fields: Mapping[str, Any]) -> str:
    holes = ", ".join(f"{part or 'what is'} in {position}" for position, part in fields["kept"].items())
    return f"{holes}: {fields.get('reason', '')}"


def _belief(fields: Mapping[str, Any]) -> str:
    goals = "  ".join(f"{name} {share:.1%}" for name, share in fields["goals"].items())
    placed = " ".join(f"{position}={part}" for position, part in fields.get("placed", {}).items())
    return f"{goals}  after {placed or 'nothing placed'}"


def _guidance(fields: Mapping[str, Any]) -> str:
    rows = {**fields["guidance"], "any part": fields.get("any_part")}
    return "; ".join(f"{part} to {', '.join(to)}" for part, to in rows.items() if to) or "nothing remains"


def _next(fields: Mapping[str, Any]) -> str:
    part, *positions = fields["next"]
    return f"next {part} to {', '.join(positions)}"


def _grasp(fields: Mapping[str, Any]) -> str:
    return f"part {fields['required']}: {fields['solution']} (graspable {fields['graspable']:.1%})"


def _verdict(fields: Mapping[str, Any]) -> str:
    subject, reason = str(fields.get("subject")), str(fields.get("reason"))
    return f"{fields['decision']}: {reason if reason.startswith(subject) else f'{subject}: {reason}'}"


def _help(fields: Mapping[str, Any]) -> str:
    costs_s, belief = fields["costs"], fields.get("belief") or {"no goal": 0.0}
    goal = max(belief, key=lambda name: belief[name])
    words = {"act_s": "acting", "wait_s": "waiting", "after_one_s": "after one more part", "ask_s": "a question"}
    text = ", ".join(f"{words[name]} {costs_s[name]:g} s" for name in words if name in costs_s)
    return f"{fields.get('text')}; {goal} {belief[goal]:.3f}, {text}"


NOTE_TEXTS: Mapping[tuple[str, str], tuple[str, Callable[[Mapping[str, Any]], str]]] = {
    # topic and a field that a note must have: the word before it, and the rest
    ("belief", "edge"): ("placed", _placed),
    ("belief", "kept"): ("stays", _stays),
    ("belief", "goals"): ("belief", _belief),
    ("plan", "guidance"): ("guidance", _guidance),
    ("plan", "next"): ("plan", _next),
    ("plan", "required"): ("plan", _grasp),
    ("verdict", "decision"): ("guard", _verdict),
    ("skill", "node"): ("skill", lambda note: f"{note['node']} {note.get('status')}: {note.get('reason')}"),
    ("cause", "relation"): ("compared", lambda note: cause_text(note).removeprefix("compared").strip()),
    ("help", "costs"): ("help", _help),
    ("help", ""): ("help", lambda note: str(note.get("text"))),
}


def cause_text(cause: Mapping[str, Any]) -> str:
    """A comparison: who compared what with which limit, and where that comes from."""
    [noted] = causes_in([cause])
    given = ", ".join(f"{name} {float(value):.4g}" for name, value in list(noted.given.items())[:MOST_FIELDS])
    place = "; ".join(filter(None, (noted.source, given)))
    return f"compared   {noted.by.rpartition('/')[2]}: {noted}" + (f" ({place})" if place else "")


def why_text(why: Mapping[str, Any]) -> str:
    """Why a tree ended so or goes on, and what would have changed it."""
    compared = [f"; {cause_text(cause)}" for cause in why.get("causes", ())]
    otherwise = f"; otherwise {why['otherwise']}" if why["otherwise"] else ""
    return "".join([str(why["text"]), *compared, otherwise])


def why_lines(why: Mapping[str, Any]) -> Iterator[str]:
    """The answer of `cell log why`: the sentence, what would have changed it, and the way there from the root."""
    yield f"{why['time_s']:.2f} s, tick {why['tick']}, {why['status']}: {why['text']}"
    if why["otherwise"]:
        yield f"  otherwise {why['otherwise']}"
    if why["guard"]["decision"]:
        yield f"  {note_text('verdict', why['guard'])}"
    for cause in why["causes"]:
        yield f"  {cause_text(cause)}, at {cause['time_s']:.2f} s"
    if not why["causes"]:
        yield "  compared   no record: whoever decided noted no comparison"
    if (tree := why.get("tree")) is None:
        return
    yield "the way from the root:"
    yield from (f"{'  ' * depth}{Step(**step)}" for depth, step in enumerate(tree["steps"], start=1))
    for beside in tree["beside"]:
        yield f"beside it: {Step(**beside['steps'][-1])}"


def command_text(command: Mapping[str, Any]) -> str:
    """What was asked of arm, gripper and wrist camera."""
    words = [word for name, word in COMMANDS.items() if command.get(name)]
    if follow := command.get("follow"):
        words.append(f"arm follows a trajectory of {follow['times_s'][-1]:.2f} s")
    if gripper := command.get("gripper"):
        words.append(f"gripper to {1e3 * gripper['opening_m']:.1f} mm")
    return f"command    {', '.join(words)}"


def display_text(display: Mapping[str, Any]) -> str:
    """What the person is shown from now on."""
    asks = f"; asks: {display['help_request']}" if display.get("help_request") else ""
    return f"shown      {display['message']}{asks}"


def tick_lines(tick: Mapping[str, Any]) -> Iterator[str]:
    """A tick of `cell log ticks`."""
    yield f"tick {tick['tick']} at {tick['time_s']:.2f} s: {tick['status']}"
    shown = [note_text(note["topic"], {k: v for k, v in note.items() if k != "topic"}) for note in tick["notes"]]
    shown += [command_text(tick["command"])] if tick["command"] else []
    shown += [display_text(tick["display"])] if tick["display"] else []
    shown += [f"why        {why_text(tick['why'])}"] if tick.get("why") else []
    yield from (f"  {line}" for line in shown)


def change_lines(changes: Sequence[StatusChange]) -> Iterator[str]:
    """A line for each node: all that its status went through in a tick, and its last word."""
    words: dict[str, list[str]] = {}
    feedback: dict[str, str] = {}
    for change in changes:
        words.setdefault(change.path, [change.old.name]).append(change.new.name)
        feedback[change.path] = change.feedback or feedback.get(change.path, "")
    for path, statuses in words.items():
        yield f"{path}: {' > '.join(statuses)}  {feedback[path]}".rstrip()


def difference_lines(difference: Difference, names: tuple[str, str] = ("was", "now")) -> list[str]:
    """Where two ticks differ: only the fields that do, where both are made of fields."""
    lines = [f"    tick {difference.tick} at {difference.time_s:.2f} s: {difference.node or difference.aspect}"]
    pair = _told(difference.aspect, difference.was), _told(difference.aspect, difference.now)
    fields = list(_differing(difference.was, difference.now))
    if pair[0] != pair[1]:
        fields = [("", *pair)]
    width = max(len(name) for name in names)
    for path, was, now in fields[:MOST_FIELDS]:
        one, other = _apart(was, now)
        if path and len(one) + len(other) < LONGEST_PAIR:
            lines.append(f"      {path}: {names[0]} {one}, {names[1]} {other}")
            continue
        lines += [f"      {path}:"] if path else []
        lines += [f"      {names[0]:{width}}  {one}", f"      {names[1]:{width}}  {other}"]
    if len(fields) > MOST_FIELDS:
        lines.append(f"      and {len(fields) - MOST_FIELDS} more fields")
    return lines


def info_lines(info: Mapping[str, Any]) -> Iterator[str]:
    """The answer of `cell log info`."""
    outcome, facts = info["outcome"], info["metadata"]
    parts = f" in {counted(len(info['parts']), 'part')}" if info["parts"] else ""
    yield f"{info['log']}: {_size(info['bytes'])}{parts}"
    yield f"  end       {outcome.get('end', 'not known')}: {outcome.get('reason', info['unfinished'])}"
    if why := outcome.get("why"):
        yield f"  why       {why_text(why)}"
    if info["unfinished"]:
        yield f"  MISSING   {info['unfinished']}"
    yield f"  ticks     {info['ticks']} in {info['duration_s']:.2f} s"
    if info["ticks"]:
        yield f"  tick took {info['tick_wall_p50_ms']} ms (median), {info['tick_wall_max_ms']} ms at most; " + (
            f"{info['overruns']} overruns"
        )
    for title, values in (("recorded with", facts), ("attached, bytes", info["attachments"])):
        yield f"{title}:"
        yield from _columns(values.items())
    yield "topics: messages, size"
    sizes = ((topic, f"{of['messages']:7d}  {_size(of['bytes']):>9}") for topic, of in info["topics"].items())
    yield from _columns(sizes)


def _columns(pairs: Iterable[tuple[str, object]]) -> Iterator[str]:
    rows = list(pairs)
    width = max((len(name) for name, _ in rows), default=0)
    return (f"  {name:{width}}  {short(value) if isinstance(value, str) else value}" for name, value in rows)


def _size(count: int) -> str:
    return f"{count / 1e6:.2f} MB" if count >= 1e5 else f"{count / 1e3:.1f} kB"


def _told(aspect: str, value: Any) -> str | None:
    """Notes and commands in words; None for other values."""
    if aspect == "command":
        return _joined([command_text(value)] if value else [])
    if aspect in NOTES and isinstance(value, list):
        return _joined([note_text(aspect, fields) for fields in value])
    return None


def _apart(was: Any, now: Any) -> tuple[str, str]:
    """Two values in as few figures as tell them apart, and by how much numbers differ that are almost the same."""
    one, other = short(was), short(now)
    if one != other:
        return one, other
    if isinstance(was, float | int) and isinstance(now, float | int):
        return repr(was), f"{now!r}, which is {now - was:+.2g}"
    return short(json.dumps(was), 10 * LONGEST_TEXT), short(json.dumps(now), 10 * LONGEST_TEXT)


def _joined(lines: Sequence[str]) -> str:
    return "; ".join(" ".join(line.split()) for line in lines) or NOTHING


def _differing(was: Any, now: Any, path: str = "") -> Iterator[tuple[str, Any, Any]]:
    """(path, one, other) of the smallest pieces in which two values differ."""
    if isinstance(was, dict) and isinstance(now, dict):
        for key in (*was, *(key for key in now if key not in was)):
            if was.get(key, ABSENT) != now.get(key, ABSENT):
                yield from _differing(was.get(key, ABSENT), now.get(key, ABSENT), f"{path}.{key}" if path else str(key))
    elif isinstance(was, list) and isinstance(now, list) and len(was) == len(now):
        places = [place for place, pair in enumerate(zip(was, now, strict=True)) if pair[0] != pair[1]]
        if len(was) > LONGEST_LIST:  # of many the one that differs most
            most = max(places, key=lambda place: _distance(was[place], now[place]))
            path = f"{path} differs in {len(places)} of {len(was)}, most at " if len(places) > 1 else path
            places = [most]
        for place in places:
            yield from _differing(was[place], now[place], f"{path}[{place}]" if path or len(was) > 1 else "")
    else:
        yield path, was, now


def _distance(was: Any, now: Any) -> float:
    """How far apart numbers, or lists of them, are; infinite for what is no number."""
    if isinstance(was, list) and isinstance(now, list) and len(was) == len(now):
        return max(map(_distance, was, now), default=0.0)
    if isinstance(was, float | int) and isinstance(now, float | int):
        return abs(now - was)
    return 0.0 if was == now else math.inf


def _brief(value: Any) -> Any:
    """Plain data with few figures, and of long lists only their ends."""
    if isinstance(value, float):
        return float(f"{value:.{FIGURES}g}")
    if isinstance(value, Mapping):
        return {key: _brief(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        if len(value) <= LONGEST_LIST:
            return [_brief(item) for item in value]
        return [_brief(value[0]), f"… {len(value) - 2} more …", _brief(value[-1])]
    return value
