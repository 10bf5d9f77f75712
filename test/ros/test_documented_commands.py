# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The commands of README and documents, run as they are written.

``ros2`` is not on PyPI: ``ros2 run`` starts the executable, and ``topic pub``, ``service call`` and
``param set`` are done by a node of the test's own with what is written behind them. CONTRIBUTING.md
lists the commands that are not run, with the reasons.
"""

from __future__ import annotations

import re
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import pytest
import yaml
from geometry_msgs.msg import WrenchStamped

from hapticmech_ros.graph.processes import private_environment
from hapticmech_ros.nodes.messages import message_class
from hapticmech_ros.system.readiness import ADDRESS, Readiness
from ros.harness import WAIT_S, Peer, Statuses, figures, program, running, six
from sampling import sampled

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "SECURITY.md"]
PAGES += sorted((ROOT / "docs").glob("*.md"))
BIN = Path(sys.prefix) / "bin"
ROW = re.compile(r"^\| (`.*`) \| .+ \|$", re.MULTILINE)


def not_run() -> tuple[str, ...]:
    """Return the beginnings of commands that are not run, of CONTRIBUTING's table of reasons."""
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    section = text[text.index("## Commands of the documents") :]
    cells = ROW.findall(section[: section.index("## Dependencies")])
    return tuple(name for cell in cells for name in re.findall(r"`([^`]+)`", cell))


NOT_RUN = not_run()
LASTING = ("hapticmech run", *(path.name for path in (ROOT / "resource" / "executables").iterdir()))
CLIENTS = ("ros2 topic pub", "ros2 service call", "ros2 param set", "python examples/")
# What must run for a command, by a name in it, where that is not `hapticmech run five_bar`.
SCENES = {"tip_pin": str(ROOT / "examples/pantograph.yaml")}
ALONE = {"topics.md"}


def commands(page: Path) -> Iterator[str]:
    """Yield the commands of a page's shell blocks, without comments."""
    text = page.read_text(encoding="utf-8")
    for block in re.findall(r"```sh\n(.*?)```", text, re.DOTALL):
        for line in block.replace("\\\n", " ").splitlines():
            words = " ".join(line.split("  #")[0].split())
            if words and not words.startswith("#"):
                ours = re.match(r"\.venv/bin/(hapticmech|scene_viewer) ", words)
                yield words.removeprefix(".venv/bin/") if ours else words


def begins(command: str, words: str) -> bool:
    return re.match(re.escape(words) + r"(?![\w-])", command) is not None


def kind_of(command: str) -> str:
    """Return how a command is run; nothing: it is not."""
    if any(begins(command, beginning) for beginning in NOT_RUN):
        return ""
    if command.startswith(CLIENTS):
        return "client"
    own = command.removeprefix("ros2 run hapticmech_ros ")
    if own.startswith(LASTING) and "--duration" not in own:
        return "lasting"
    return "finite"


ALL = {page: list(commands(page)) for page in PAGES}
FINITE = {p: found for p in PAGES if (found := [c for c in ALL[p] if kind_of(c) == "finite"])}
EACH_LASTING = sorted({c for p in PAGES for c in ALL[p] if kind_of(c) == "lasting"})
EACH_CLIENT = sorted({(p.name, c) for p in PAGES for c in ALL[p] if kind_of(c) == "client"})


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder like the clone, in which results may be left."""
    for name in ("examples", "config", "docs"):
        (tmp_path / name).symlink_to(ROOT / name)
    (tmp_path / "bags").mkdir()
    return tmp_path


def words_of(command: str) -> list[str]:
    words = shlex.split(command.removeprefix("ros2 run hapticmech_ros "), comments=True)
    program = sys.executable if words[0] == "python" else str(BIN / words[0])
    return [program, *words[1:]]


def succeeds(command: str, folder: Path, domain: int, timeout: float) -> str:
    """Run a command that ends by itself, and return what it printed."""
    run = subprocess.run(
        words_of(command),
        cwd=folder,
        env=private_environment(domain),
        capture_output=True,
        text=True,
        timeout=timeout,
        check=False,
    )
    assert run.returncode == 0, f"{command}: {run.stdout[-2000:]} {run.stderr[-2000:]}"
    return run.stdout


# What the README says, in every run.
@pytest.mark.parametrize(
    "page",
    [PAGES[0], *sampled([p for p in FINITE if p != PAGES[0]], every=12)],
    ids=lambda p: p.name,
)
def test_commands_that_end_by_themselves_succeed_in_their_order(
    page: Path, folder: Path, domain: int
) -> None:
    for command in FINITE[page]:
        written, _, redirected = command.partition(" > ")
        printed = succeeds(written, folder, domain, 180)
        if redirected:
            assert printed
            (folder / redirected).write_text(printed, encoding="utf-8")


@contextmanager
def started(words: Sequence[str], folder: Path, domain: int) -> Iterator[subprocess.Popen[str]]:
    """Start a command and wait until it is ready; end it with the block."""
    readiness, output = Readiness(), folder / "output"
    with (
        closing(readiness),
        output.open("w") as stream,
        program(
            domain,
            *words,
            environment={ADDRESS: readiness.address},
            cwd=folder,
            stdout=stream,
            stderr=subprocess.STDOUT,
        ) as process,
    ):
        end = time.monotonic() + 2 * WAIT_S
        while process.pid not in readiness.pids():
            assert process.poll() is None, output.read_text()
            assert time.monotonic() < end, f"{words} is not ready"
            time.sleep(0.02)
        yield process


@pytest.mark.parametrize("command", sampled(EACH_LASTING, every=2))
def test_commands_that_last_start_and_end_with_ctrl_c(
    command: str, folder: Path, domain: int, peer: Peer, statuses: Statuses
) -> None:
    if "mine.yaml" in command:
        (folder / "mine.yaml").write_bytes((ROOT / "config/scenes/five_bar.yaml").read_bytes())
    with started(words_of(command), folder, domain) as process:
        if command.startswith("hapticmech run"):
            peer.until(
                lambda: any(
                    name.endswith("haptic_device") and status.message == "rendering"
                    for name, status in statuses.items()
                ),
                "a force",
                2 * WAIT_S,
            )
        process.send_signal(signal.SIGINT)
        assert process.wait(WAIT_S) == 0, (folder / "output").read_text()


@pytest.mark.parametrize(("page", "command"), sampled(EACH_CLIENT, every=2))
def test_commands_to_a_running_graph_are_obeyed(
    page: str, command: str, folder: Path, domain: int, peer: Peer, statuses: Statuses
) -> None:
    scene = next((there for name, there in SCENES.items() if name in command), "five_bar")
    nodes = "haptic_device" if page in ALONE else ",".join(FOUR)
    with running(nodes, domain, scene, diagnostics_period=0.1, control_rate=0.0):
        peer.until(lambda: len(statuses) == len(nodes.split(",")), "diagnostics")
        if page not in ALONE:
            peer.until(
                lambda: statuses["haptic_device"].message == "rendering", "a force", 2 * WAIT_S
            )

        def refused() -> dict[str, str]:
            """Return what each node refused last, but what nodes sent each other too long ago."""
            last = {name: figures(status)["last_refusal"] for name, status in statuses.items()}
            return {
                name: why
                for name, why in last.items()
                if why and (why.partition(":")[0] in command or "age of stamp" not in why)
            }

        do_as_client(peer, command, folder, domain)
        peer.run(0.5)
        assert not refused()


FOUR = ("haptic_device", "mechanism_simulator", "nullspace_analyser", "teleoperation_controller")


def test_the_program_that_pushes_pushes(folder: Path, domain: int, peer: Peer) -> None:
    page = (ROOT / "docs" / "wrenches.md").read_text(encoding="utf-8")
    (pushes,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    (folder / "pusher.py").write_text(pushes, encoding="utf-8")
    received = peer.listen("mechanism/handle/external_cf/pusher", WrenchStamped)
    with program(domain, sys.executable, "pusher.py", cwd=folder):
        peer.until(lambda: len(received) > 2, "wrenches", 2 * WAIT_S)
    assert {(message.header.frame_id, *six(message)) for message in received} == {
        ("world", 0.0, 0.4, 0.0, 0.0, 0.0, 0.0)
    }


def do_as_client(peer: Peer, command: str, folder: Path, domain: int) -> None:
    """Do what a command asks for, and check that it was answered, where answers are given."""
    words = shlex.split(command)
    if words[0] == "python":
        succeeds(command, folder, domain, 60)
    elif words[1:3] == ["topic", "pub"]:
        once = "--once" in words
        name, kind, *content = [word for word in words[3:] if word not in ("-r", "50", "--once")]
        made = message_class(kind)()
        fill(made, yaml.safe_load(content[0]) if content else {})
        publisher = peer.publisher(name, type(made))
        for _ in range(1 if once else 10):
            publisher.publish(made)
            peer.run(0.02)
    elif words[1:3] == ["service", "call"]:
        package, _, kind = words[4].partition("/srv/")
        service = getattr(__import__(f"{package}.srv", fromlist=[kind]), kind)
        request = service.Request()
        fill(request, yaml.safe_load(words[5]))
        answer = peer.call(service, words[3], request)
        assert answer.success, answer
    else:
        node, name, value = words[3:]
        result = peer.set_parameters(node, **{name: value})
        assert result.successful, result.reason


def fill(message: Any, values: dict[str, Any]) -> None:
    """Put values into a message, as ``ros2 topic pub`` does; an unknown field is an error."""
    for name, value in values.items():
        field = getattr(message, name)
        if isinstance(value, dict):
            fill(field, value)
        else:
            setattr(message, name, type(field)(value))


def test_every_command_is_run_or_has_a_reason() -> None:
    """Each reason is of some command, so that none outlives it."""
    every = [command for page in PAGES for command in ALL[page]]
    assert len(every) > 120
    unused = [
        beginning
        for beginning in NOT_RUN
        if not any(begins(command, beginning) for command in every)
    ]
    assert not unused
    run = [command for command in every if kind_of(command)]
    assert len(run) > 45
