"""The safety configuration: one hash over what decides on people, signed by a person before real devices move."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml

import bracket_cell
from bracket_cell.commands.main import main
from bracket_cell.configuration import DEFAULT_CONFIGURATION, load_configuration, load_faults, load_product
from bracket_cell.running import fault_checks
from bracket_cell.runs.signing import required_signature, sign, signature_file, signature_of
from bracket_cell.wiring import limits
from bracket_cell.wiring.safety import hash_of, other_limits, safety_from, safety_of
from bracket_ground.errors import InputError
from bracket_ground.interfaces.faults import SIGNALS

Change = Callable[[dict[str, Any]], object]


def cell_in(folder: Path, change: Change = lambda _: None) -> Path:
    """A configuration of real devices, none of which can be opened."""
    data = yaml.safe_load(DEFAULT_CONFIGURATION.read_text())
    data |= {"product": str(DEFAULT_CONFIGURATION.with_name("products.yaml")), "perception": {"kind": "classical"}}
    data["devices"] = {
        "arm": {"kind": "ur", "host": "127.0.0.99"},
        "gripper": {"kind": "robotiq_modbus", "port": "/dev/nothing"},
        "overhead": {"kind": "v4l2", "device": "/dev/nothing0"},
        "wrist": {"kind": "v4l2", "device": "/dev/nothing1"},
        "panel": {"kind": "none"},
    }
    change(data)
    path = folder / "cell.yaml"
    path.write_text(yaml.safe_dump(data))
    return path


def put(*keys: Any) -> Change:
    """A change of one value."""
    *around, last, value = keys

    def change(data: dict[str, Any]) -> None:
        for key in around:
            data = data.setdefault(key, {})
        data[last] = value

    return change


@pytest.mark.parametrize(
    ("change", "key"),
    [
        (put("controller", "tick_hz", 20.0), "controller.tick_hz: signed 25.0, now 20.0"),
        (put("controller", "stop_timeout_s", 5.0), "controller.stop_timeout_s: signed 2.0, now 5.0"),
        (put("motion", "separation", "intrusion_m", 0.2), "motion.separation.intrusion_m: signed 0.1, now 0.2"),
        (put("motion", "speed_share", 0.5), "motion.speed_share: signed 1.0, now 0.5"),
        (put("motion", "grip_force_n", 80.0), "motion.grip_force_n: signed 60.0, now 80.0"),
        (put("robot", "ur10e"), "robot.name: signed ur10, now ur10e"),
        (put("bench", "overhead", "mount", "position_m", [0.8, 0.0, 1.4]), "bench.overhead.mount.position_m"),
        (put("bench", "obstacles", [{"name": "post", "position_m": [0, 0.5, 0.2], "box_m": [0.1, 0.1, 0.4]}]), "post"),
        (put("devices", "arm", "host", "127.0.0.98"), "devices.arm.host: signed 127.0.0.99, now 127.0.0.98"),
        (put("devices", "overhead", "delay_s", 0.02), "devices.overhead.delay_s"),
        (put("perception", "hands", {"kind": "slim"}), "hands.kind: signed classical, now slim"),
        (put("unsafe_table", True), "unsafe_table: signed false, now true"),
    ],
)
def test_what_decides_on_people_is_in_the_hash_and_named_where_it_changes(
    tmp_path: Path, change: Change, key: str
) -> None:
    signed = safety_from(cell_in(tmp_path))
    now = safety_from(cell_in(tmp_path, change))
    assert now.sha256 != signed.sha256
    assert any(key in line for line in now.changes(signed.values)), now.changes(signed.values)
    assert signed.changes(signed.values) == []


@pytest.mark.parametrize(
    "change",
    [
        put("controller", "max_duration_s", 10.0),
        put("log", "jpeg_quality", 50),
        put("bench", "bins_m", "o1", [1.0, 0.3, 0.004]),
        put("guard", "wrong_act_s", 80.0),
        put("motion", "separation", {}),
    ],
)
def test_what_does_not_is_not(tmp_path: Path, change: Change) -> None:
    assert safety_from(cell_in(tmp_path)).sha256 == safety_from(cell_in(tmp_path, change)).sha256


def test_every_row_of_the_fault_table_with_its_reset_is_in_it_in_whatever_order_it_stands(tmp_path: Path) -> None:
    safety = safety_from(cell_in(tmp_path))
    assert {f"faults.{signal}.{key}" for signal in SIGNALS for key in ("action", "clear")} <= set(safety.values)
    (tmp_path / "mine.yaml").write_text(
        "extends: shipped\nfaults:\n  - {signal: tick_very_late, action: stop, clear: never}\n"
    )
    assert safety_from(cell_in(tmp_path, put("faults", "mine.yaml"))).sha256 == safety.sha256
    (tmp_path / "mine.yaml").write_text(
        "extends: shipped\nfaults:\n  - {signal: tick_late, action: stop, clear: never}\n"
    )
    changes = safety_from(cell_in(tmp_path, put("faults", "mine.yaml"))).changes(safety.values)
    assert "faults.tick_late.action: signed slow, now stop" in changes
    assert all(line.startswith("faults.tick_late.") for line in changes)


def test_numbers_in_code_that_judge_are_in_it(monkeypatch: pytest.MonkeyPatch) -> None:
    configuration = load_configuration()
    product, table = load_product(configuration), load_faults(configuration)
    signed = safety_of(configuration, product, table)
    looser = replace(fault_checks.LIMITS, off_path_rad=0.5)
    monkeypatch.setattr("bracket_cell.wiring.limits.RECORDS", {**limits.RECORDS, "fault_checks": looser})
    changes = safety_of(configuration, product, table).changes(signed.values)
    assert changes == ["limits.fault_checks.off_path_rad: signed 0.025, now 0.5"]


def test_the_map_of_where_a_hand_could_be_clamped_is_signed_with_its_speed(tmp_path: Path) -> None:
    assert not [key for key in safety_from(cell_in(tmp_path)).values if key.startswith("clamps.")]
    post = {"name": "post", "position_m": [0, 0.5, 0.2], "box_m": [0.1, 0.1, 0.4]}
    limited = put("motion", "separation", "clamp_n", 140.0)
    signed = safety_from(cell_in(tmp_path, lambda data: (limited(data), put("bench", "obstacles", [post])(data))))
    assert signed.values["clamps.closing_m_s"] == pytest.approx(0.129, abs=0.001)
    assert signed.values["clamps.at.post"] == [[-0.05, 0.45, 0.0], [0.05, 0.55, 0.4]]
    assert "clamps.at.the table" in signed.values


def test_every_record_of_limits_is_in_it_with_the_meaning_of_each_number() -> None:
    rooms = ("running", "skills/motion", "learned/classical")
    files = [file for room in rooms for file in (Path(bracket_cell.__file__).parent / room).glob("*.py")]
    written = {name for file in files for name in re.findall(r"^class (\w+Limits)\b", file.read_text(), re.MULTILINE)}
    assert written - {"StopLimits"} == {
        *(type(record).__name__ for record in limits.RECORDS.values()),
        *(kind.__name__ for kind in limits.FIXED.values()),
    }
    for limit in limits.described():
        assert limit.meaning, limit.key
        assert limit.origin, limit.key


def test_doctor_prints_them(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["doctor", "--limits"]) == 0
    printed = capsys.readouterr().out
    assert re.search(r"fault_checks\.off_path_rad +0\.025 +\[rad\]", printed)
    assert re.search(r"motion\.separation\.hand_height_m +0\.3 +\[m\]", printed)


def test_what_no_file_sets_any_more_is_signed_and_told_where_a_log_has_it_otherwise() -> None:
    values = {"motion.contact_lag_m": 0.003, "motion.separation.hand_height_m": 0.3, "classical.still_m": 0.01}
    assert safety_from(DEFAULT_CONFIGURATION).values.items() >= {"motion.contact_lag_m": 0.002}.items()
    now = {f"limits.{name}.{key}": value for name, record in limits.values().items() for key, value in record.items()}
    assert other_limits(json.dumps(values | now)) == [
        "classical.still_m: was 0.01, now 0.006",
        "motion.contact_lag_m: was 0.003, now 0.002",
    ]


def test_a_run_on_real_devices_is_refused_until_somebody_signs_exactly_this(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, log = cell_in(tmp_path), tmp_path / "a.mcap"
    run = ["run", "--config", str(path), "--log", str(log)]
    assert main(run) == 2
    assert "nobody signed the safety configuration" in capsys.readouterr().err
    short = safety_from(path).short
    assert main(["safety", "sign", "--by", "A. Smith", "--config", str(path), "--hash", "0" * 12]) == 2
    assert "nothing was signed" in capsys.readouterr().err
    assert not signature_file(path).exists()
    assert main(["safety", "sign", "--by", "A. Smith", "--config", str(path), "--hash", short]) == 0
    assert short in capsys.readouterr().err
    assert main(run) != 2  # the devices are what is missing now
    assert "127.0.0.99" in capsys.readouterr().err
    cell_in(tmp_path, put("controller", "tick_hz", 20.0))
    assert main(run) == 2
    told = capsys.readouterr().err
    assert "signed by A. Smith" in told
    assert "controller.tick_hz: signed 25.0, now 20.0" in told
    assert "motion.separation.reaction_s: signed 0.093, now 0.103" in told
    assert not log.exists()


def test_signing_says_first_what_changed_and_keeps_who_signed_before(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = cell_in(tmp_path)
    first = sign(path, safety_from(path), "A. Smith")
    cell_in(tmp_path, put("controller", "tick_hz", 20.0))
    words = ["safety", "sign", "--by", "B. Jones", "--config", str(path)]
    assert main([*words, "--hash", first.sha256]) == 2
    told = capsys.readouterr().err
    assert "controller.tick_hz: signed 25.0, now 20.0" in told
    assert signature_of(path) == first
    assert main([*words, "--hash", safety_from(path).short]) == 0
    signature = signature_of(path)
    assert signature is not None
    assert (signature.by, [signed.by for signed in signature.earlier]) == ("B. Jones", ["A. Smith"])
    capsys.readouterr()
    assert main([*words, "--hash", signature.sha256]) == 0
    assert "nothing changed since" in capsys.readouterr().err
    assert signature_of(path) == signature


def test_signing_without_a_terminal_and_in_nobodys_name_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    import io

    path = cell_in(tmp_path)
    monkeypatch.setattr("sys.stdin", io.StringIO(""))
    assert main(["safety", "sign", "--by", "A. Smith", "--config", str(path)]) == 2
    assert "nobody typed the hash" in capsys.readouterr().err
    assert main(["safety", "sign", "--by", "  ", "--config", str(path)]) == 2
    assert not signature_file(path).exists()
    monkeypatch.setattr("sys.stdin", io.StringIO(safety_from(path).sha256[:8] + "\n"))
    assert main(["safety", "sign", "--by", "A. Smith", "--config", str(path)]) == 0
    assert required_signature(path, safety_from(path)).by == "A. Smith"


def test_show_has_values_hash_signature_and_changes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = cell_in(tmp_path)
    assert main(["safety", "show", "--config", str(path), "--json"]) == 1
    told = json.loads(capsys.readouterr().out)
    assert told["signed"] is None
    assert hash_of(told["values"]) == told["sha256"] == safety_from(path).sha256
    sign(path, safety_from(path), "A. Smith")
    assert main(["safety", "show", "--config", str(path)]) == 0
    assert "signed by A. Smith" in capsys.readouterr().out
    cell_in(tmp_path, put("controller", "tick_hz", 20.0))
    assert main(["safety", "show", "--config", str(path)]) == 1
    assert "controller.tick_hz: signed 25.0, now 20.0" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("controller.tick_hz: 25.0", "controller.tick_hz: 20.0", "somebody edited this file"),
        ("by: A. Smith", "by: ''", "by"),
        ("values:", "valus:", "unknown key 'valus'"),
        ("utc:", "utc: [", "not YAML"),
    ],
)
def test_a_signature_that_was_edited_is_none(tmp_path: Path, old: str, new: str, complaint: str) -> None:
    path = cell_in(tmp_path)
    sign(path, safety_from(path), "A. Smith")
    text = signature_file(path).read_text()
    assert old in text
    signature_file(path).write_text(text.replace(old, new))
    with pytest.raises(InputError, match=complaint) as caught:
        required_signature(path, safety_from(path))
    assert str(signature_file(path)) in str(caught.value)


def test_a_slower_run_needs_no_other_signature_and_none_is_faster_than_signed() -> None:
    motion = load_configuration().motion
    assert (motion.slowed(0.25).speed_share, motion.slowed(0.25).configured_share) == (0.25, 1.0)
    half = motion.model_copy(update={"speed_share": 0.5})
    assert (half.slowed(1.0).speed_share, half.slowed(1.0).configured_share) == (0.5, 0.5)
