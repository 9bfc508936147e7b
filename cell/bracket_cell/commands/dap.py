"""`cell dap`: breakpoints in tree files for editors, which start it and talk to it over stdin and stdout.

It speaks the Debug Adapter Protocol: https://microsoft.github.io/debug-adapter-protocol.
"""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from io import FileIO
from queue import Empty, SimpleQueue
from socket import create_server
from typing import IO, Any

from bracket_cell.commands.options import MONITOR_PORT
from bracket_cell.viewing.debugger import Body, Debugger
from bracket_ground.errors import InputError, mistakes

POLL_S = 0.2  # between two looks at the run: breakpoints rest after 5 s without one
END_S = 10.0  # a run stops the arm before it ends
TRIES = 20
MOST_BYTES = 1_000_000  # of a request
REAL_TIME = ("--real-time",)
CAPABILITIES = {
    "supportsConfigurationDoneRequest": True,
    "supportsEvaluateForHovers": True,
    "supportsTerminateRequest": True,
}


def dap() -> None:
    """Serve an editor's debugger: breakpoints in tree files, steps, blackboard and statuses of a running tree."""
    Adapter(FileIO(sys.stdin.fileno(), closefd=False), sys.stdout.buffer).serve()


class Adapter:
    """One editor's session: it launches `cell run`, or attaches to a run with `--open breakpoints`.

    Args:
        source: without a buffer, whose lock a thread that waits would keep at the program's end.
    """

    def __init__(self, source: FileIO, sink: IO[bytes]) -> None:
        self._source, self._sink, self._sent = source, sink, 0
        self._inbox: SimpleQueue[tuple[str, Any]] = SimpleQueue()
        self._debugger: Debugger | None = None
        self._command: list[str] = []  # of the run to launch; none where one is attached to
        self._run: subprocess.Popen[str] | None = None
        self._looks = self._over = False

    def serve(self) -> None:
        """Answer until the editor hangs up."""
        self._listen("request", _messages(self._source))
        try:
            while not self._over:
                self._turn()
        finally:
            self._end()

    def _turn(self) -> None:
        try:
            kind, message = self._inbox.get(timeout=POLL_S)
        except Empty:
            self._look()
            return
        if kind == "output":
            self._event("output", {"category": "stdout", "output": message})
        elif kind == "request":
            self._answer(message)
        elif kind == "request ended":
            self._over = True
        elif self._run is not None:
            self._event("exited", {"exitCode": self._run.wait()})
            self._ended()

    def _look(self) -> None:
        if self._debugger is not None and self._looks:
            self._debugger.poll()
            if self._debugger.over and self._run is None:
                self._ended()

    def _ended(self) -> None:
        self._looks = False
        self._event("terminated", {})

    def _answer(self, request: Mapping[str, Any]) -> None:
        command, asked = request["command"], request.get("arguments") or {}
        fields: Body = {"type": "response", "request_seq": request["seq"], "command": command, "success": True}
        try:
            fields["body"] = self._does(command)(asked)
        except (InputError, LookupError, TypeError, ValueError, AttributeError) as error:
            fields |= {"success": False, "message": f"{command}: {mistakes(error)[0]}"}
        self._write(fields)
        if command in ("launch", "attach") and fields["success"]:
            self._event("initialized", {})

    def _does(self, command: str) -> Callable[[Body], Body]:
        own: dict[str, Callable[[Body], Body]] = {
            "initialize": lambda _: dict(CAPABILITIES),
            "launch": self._launch,
            "attach": lambda asked: self._watch(asked.get("port", MONITOR_PORT)),
            "configurationDone": self._configured,
            "terminate": self._leave,
            "disconnect": self._leave,
        }
        if command in own:
            return own[command]
        if (debugger := self._debugger) is None:
            raise InputError("launch or attach comes first")
        known: dict[str, Callable[[Body], Body]] = {
            "setBreakpoints": debugger.set_breakpoints,
            "threads": debugger.threads,
            "stackTrace": debugger.stack_trace,
            "scopes": debugger.scopes,
            "variables": debugger.variables,
            "evaluate": debugger.evaluate,
            "pause": debugger.pause,
            "continue": debugger.go_on,
            **dict.fromkeys(("next", "stepIn", "stepOut"), debugger.step),
        }
        if command not in known:
            raise InputError(f"unknown; known: {', '.join([*own, *known])}")
        return known[command]

    def _launch(self, asked: Body) -> Body:
        """Get a run ready: `program` is the tree, `args` are options of `cell run`."""
        port = _free_port()
        self._command = [sys.executable, "-m", "bracket_cell", "run", asked["program"], *asked.get("args", REAL_TIME)]
        self._command += ["--open", f"debugger={port}"]
        return self._watch(port)

    def _watch(self, port: object) -> Body:
        if not isinstance(port, int):
            raise InputError(f"port {port!r} is no number")
        self._debugger = Debugger(port, self._event)
        return {}

    def _configured(self, _: Body) -> Body:
        """The breakpoints are known: the run may begin."""
        self._looks = True
        if self._command:
            self._run = subprocess.Popen(
                self._command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
            )
            assert self._run.stdout is not None
            self._listen("output", self._run.stdout)
        return {}

    def _leave(self, _: Body) -> Body:
        self._over = True
        return {}

    def _end(self) -> None:
        """Nothing waits for an editor that has left; a run that it launched ends as by Ctrl-C."""
        if self._debugger is not None:
            self._debugger.leave()
        if self._run is None or self._run.poll() is not None:
            return
        self._run.send_signal(signal.SIGINT)
        try:
            self._run.wait(END_S)
        except subprocess.TimeoutExpired:
            self._run.terminate()

    def _listen(self, kind: str, source: Iterable[Any]) -> None:
        """Pass on what comes, in a thread of its own."""

        def listen() -> None:
            try:
                for message in source:
                    self._inbox.put((kind, message))
            except ValueError as error:  # what comes is no message of the protocol: nothing behind it can be read
                sys.stderr.write(f"cell: {kind} of the debugger cannot be read: {error}\n")
            self._inbox.put((f"{kind} ended", None))

        threading.Thread(target=listen, name=f"debugger's {kind}", daemon=True).start()

    def _event(self, name: str, body: Body) -> None:
        self._write({"type": "event", "event": name, "body": body})

    def _write(self, message: Body) -> None:
        self._sent += 1
        body = json.dumps({"seq": self._sent, **message}).encode()
        try:
            self._sink.write(b"Content-Length: %d\r\n\r\n%b" % (len(body), body))
            self._sink.flush()
        except BrokenPipeError:
            self._over = True


def _messages(source: FileIO) -> Iterator[Mapping[str, Any]]:
    """What an editor sends: a header with the length, an empty line, JSON; raises ValueError for anything else."""
    length = 0
    while line := source.readline(MOST_BYTES):
        name, _, value = line.partition(b":")
        if name.lower() == b"content-length":
            if not 0 < (length := int(value)) <= MOST_BYTES:
                raise ValueError(f"it has {length} bytes; legal: 1 to {MOST_BYTES}")
        elif not line.strip() and length:
            body = b""
            while len(body) < length and (piece := source.read(length - len(body))):
                body += piece
            yield _request(body)
            length = 0


def _request(body: bytes) -> Mapping[str, Any]:
    try:
        request = json.loads(body)
    except RecursionError:
        request = None
    if not isinstance(request, dict) or not {"command", "seq"} <= request.keys():
        raise ValueError("it is no request with a command and a seq")
    return request


def _free_port() -> int:
    """A port that is free, and the one behind it."""
    for _ in range(TRIES):
        with create_server(("127.0.0.1", 0)) as first:
            port = int(first.getsockname()[1])
            try:
                create_server(("127.0.0.1", port + 1)).close()
            except OSError:
                continue
        return port
    raise InputError("no two free ports beside each other were found on this machine")
