"""The human player on a real terminal and with piped input; it sees only the agent's window."""

from __future__ import annotations

import io
import os
import re
import select
import signal
import struct
import subprocess
import sys
import time

import pytest
from rich.console import Console

import smartplay_tools as sp
from smartplay_tools.evaluation.run_folder.folder import RunFolder
from smartplay_tools.players.human.player import HumanPlayer
from smartplay_tools.types.messages import calls_of, text_of
from tests.processes import heed_interrupts, needs_unix

HANOI, RPS, CRAFTER = "Hanoi3Disk-v0", "RockPaperScissorBasic-v0", "Crafter-v0"
CLEAR, ENTER, LEAVE = "\x1b[2J", "\x1b[?1049h", "\x1b[?1049l"


# Piped input.


def sit(answers: str, game: str = RPS, protocol: str = "tools", **options: object):
    """Play with answers that were typed beforehand; return the result, the conversation's record and what was shown."""
    console = Console(file=io.StringIO(), width=100, color_system=None)
    player = HumanPlayer(console=console, lines=io.StringIO(answers))
    record: list = []
    with sp.Episode(game, seed=1, transcript=record, **options) as episode:
        result = sp.play(episode, player, protocol=protocol)
    return result, record, console.file.getvalue()


def calls(record) -> list[tuple[str, str]]:
    return [(event["name"], event["arguments"]) for event in record if event["event"] == "call"]


@pytest.mark.parametrize(
    ("typed", "sent"),
    [
        ("2", ("act", '{"action": "Paper"}')),
        ("Paper", ("act", '{"action": "Paper"}')),
        ("  paper  ", ("act", '{"action": "Paper"}')),
        ("o", ("observe", "{}")),
        ("m", ("read_manual", "{}")),
    ],
)
def test_what_is_typed_becomes_a_call(typed, sent):
    _, record, _ = sit(typed + "\n")
    assert calls(record) == [sent]


def test_numbers_are_those_of_the_manual():
    """Crafter's manual numbers its actions in another order than the game."""
    _, record, shown = sit("1\n", CRAFTER)
    assert "1. Move West" in shown
    assert calls(record) == [("act", '{"action": "Move West"}')]


def test_a_final_full_stop_does_not_matter():
    _, record, _ = sit("pull slot machine 2\n", "BanditTwoArmedLowLowFixed-v0")
    assert calls(record) == [("act", '{"action": "Pull slot machine 2."}')]


def test_help_says_what_can_be_typed():
    _, _, shown = sit("?\n")
    assert "observe: show the current observation again" in shown


def test_a_slip_is_asked_about_again_and_costs_nothing():
    result, record, shown = sit("4\n0\nLizard\n\n²\n1\n")
    assert calls(record) == [("act", '{"action": "Rock"}')]
    assert (result.illegal_actions, result.malformed_calls, result.idle_replies) == (0, 0, 0)
    assert "'Lizard' is not an action here" in shown


def test_words_of_ones_own_stay_in_the_window():
    _, record, shown = sit("1 # it likes paper\n2\n")
    words = [text_of(event["message"]) for event in record if event["event"] == "message"]
    assert words == ["it likes paper", ""]
    assert shown.count("it likes paper") >= 2  # as it was typed, and in the prompts after it


@pytest.mark.parametrize("answers", ["1\nq\n2\n", "1\n"], ids=["q", "end of input"])
def test_leaving_closes_the_episode(answers):
    result, record, _ = sit(answers)
    assert (result.end_reason, result.error, result.steps) == ("closed", None, 1)
    assert record[-1]["event"] == "end"


def test_the_papers_two_questions():
    result, record, _ = sit("paper beats rock\nwhatever\n2\n\n1\n", protocol="paper")
    words = [text_of(event["message"]) for event in record if event["event"] == "message"]
    assert words == ["paper beats rock", "Paper", "", "Rock"]
    assert (result.steps, result.fallback_actions) == (2, 0)


def test_the_person_sees_what_an_agent_sees():
    """Every prompt that an agent would have been given is on the screen word for word, and nothing else of the game."""
    answers = ["m", "o", "1", "2", "3", "1"]
    budget = sp.Budget(history=1, prompt_tokens=900)
    _, _, shown = sit("\n".join(answers) + "\n", budget=budget)
    screens = re.split(r"─+ prompt ─+\n", shown)[1:]
    moves = {"m": ("read_manual", "{}"), "o": ("observe", "{}")}
    moves |= {str(n): ("act", f'{{"action": "{name}"}}') for n, name in enumerate(("Rock", "Paper", "Scissor"), 1)}
    with sp.Episode(RPS, seed=1, budget=budget) as episode:
        conversation = sp.Conversation(episode)
        for screen, answer in zip(screens, answers, strict=False):
            messages = conversation.prompt().messages
            texts = [text_of(message) for message in messages]
            texts += [call["function"]["name"] for message in messages for call in calls_of(message)]
            assert all(plain(text) in plain(screen) for text in texts)
            assert plain(screen).count("You chose") == sum(text.count("You chose") for text in texts)
            name, arguments = moves[answer]
            call = {"id": "c", "type": "function", "function": {"name": name, "arguments": arguments}}
            conversation.receive({"role": "assistant", "content": None, "tool_calls": [call]})


def plain(text: str) -> str:
    return " ".join(text.split())


def test_the_budget_bars_add_up():
    """Prompts and replies so far, this prompt and the longest reply are the cap."""
    budget = sp.Budget(episode_tokens=5_000)
    _, record, shown = sit("1\n2\nm\n", budget=budget)
    screens = re.split(r"─+ prompt ─+\n", shown)[1:]
    views = [event for event in record if event["event"] == "view"]
    usages = [event for event in record if event["event"] == "usage"]
    for screen, view, used in zip(screens, views, range(len(usages)), strict=False):
        found = re.search(r"prompt ([\d,]+), episode ([\d,]+)/5,000, .*reply ([\d,]+)", screen).groups()
        prompt, spent, reply = map(number, found)
        assert prompt == view["tokens"]
        assert spent == sum(usage["prompt"] + usage["reply"] for usage in usages[:used]) + prompt
        assert spent + reply == 5_000


def number(text: str) -> int:
    return int(text.replace(",", ""))


# A terminal.


class Terminal:
    """A program on a pseudo-terminal of a given size: type a line, see the screen."""

    def __init__(self, *words: str, rows: int = 30, columns: int = 100) -> None:
        needs_unix()
        import fcntl
        import pty
        import termios

        self._master, slave = pty.openpty()
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))
        fixed = ("COLUMNS", "LINES", "NO_COLOR")
        environment = {name: value for name, value in os.environ.items() if name not in fixed}
        self._program = subprocess.Popen(
            [sys.executable, "-m", "smartplay_tools", *words],
            stdin=slave,
            stdout=slave,
            stderr=slave,
            env={**environment, "TERM": "xterm-256color"},
            start_new_session=True,
            preexec_fn=heed_interrupts,
        )
        os.close(slave)
        self.rows = rows
        self.seen = ""

    def type(self, line: str) -> None:
        os.write(self._master, f"{line}\n".encode())
        self.seen = ""

    def screen(self) -> str:
        """Wait until the program asks; return the contents of the screen."""
        self._read_until(lambda: re.search(r"> (\x1b\[\d*m)?$", self.seen) is not None)
        return re.sub(r"\x1b\[[?0-9;]*[a-zA-Z]", "", self.seen.rpartition(CLEAR)[2]).replace("\r", "")

    def rest(self) -> str:
        """Wait for the program's end; return its output."""
        self._read_until(lambda: False)
        return self.seen

    def interrupt(self) -> None:
        """Send the signal of Ctrl-C while the program waits for a line."""
        time.sleep(0.5)  # what it has asked it may not yet be waiting for
        self._program.send_signal(signal.SIGINT)
        self.seen = ""

    def code(self) -> int:
        """Wait for the program's end and return its exit code."""
        return self._program.wait(timeout=20)

    def __enter__(self) -> Terminal:
        return self

    def __exit__(self, *error: object) -> None:
        self._program.kill()
        self._program.wait()
        os.close(self._master)

    def _read_until(self, enough) -> None:
        until = time.monotonic() + 60
        while not enough():
            ready, _, _ = select.select([self._master], [], [], until - time.monotonic())
            assert ready, f"nothing came any more after {self.seen[-300:]!r}"
            try:
                data = os.read(self._master, 65536)
            except OSError:  # Linux raises this when the other side has ended
                data = b""
            if not data:
                return
            self.seen += data.decode(errors="ignore")


@pytest.mark.slow
def test_on_a_terminal_what_has_left_the_window_is_gone(tmp_path):
    record = tmp_path / "human.jsonl"
    words = ["play", RPS, "--player", "human", "--history", "0", "--transcript", str(record)]
    with Terminal(*words) as terminal:
        screens = [terminal.screen()]
        assert terminal.seen.count(ENTER) == 1  # the alternate screen, which cannot be scrolled back
        for answer in ("1", "3"):
            terminal.type(answer)
            screens.append(terminal.screen())
        terminal.type("q")
        printed = terminal.rest()
        assert terminal.code() == 0
    first, second, third = screens
    assert "1. Rock" in first
    assert "You chose Rock" in second
    assert "You chose Scissor" in third
    assert "You chose Rock" not in third
    assert all(len(screen.splitlines()) <= terminal.rows for screen in screens)
    assert LEAVE in printed
    assert "You chose" not in printed  # nor does the ordinary screen show the game afterwards
    assert "closed" in printed
    assert calls(sp.read_transcript(record)) == [("act", '{"action": "Rock"}'), ("act", '{"action": "Scissor"}')]


@pytest.mark.slow
def test_a_prompt_taller_than_the_terminal_is_paged():
    with Terminal("play", CRAFTER, "--player", "human", "--manual", "pinned", rows=24, columns=80) as terminal:
        screens = [terminal.screen()]
        while not screens[-1].count("You’re a player"):
            assert re.search(r"[1-9]\d* lines above \(u\)", screens[-1])
            terminal.type("u")
            screens.append(terminal.screen())
        terminal.type("?")
        helping = terminal.screen()
        terminal.type("d")
        down = terminal.screen()
        terminal.type("q")
        terminal.rest()
        assert terminal.code() == 0
    assert "0 below (d)" in screens[0]
    assert re.search(r"\b0 lines above", screens[-1])
    assert "page up and down" in helping
    assert down != screens[-1]
    assert all(len(screen.splitlines()) <= 24 for screen in [*screens, helping, down])
    # Nothing is lost between the pages.
    pages = "\n".join(reversed(screens))
    assert all(action in pages for action in sp.GAMES[CRAFTER].load().actions)


@pytest.mark.slow
def test_an_interrupt_gives_the_terminal_back(tmp_path):
    record = tmp_path / "human.jsonl"
    with Terminal("play", RPS, "--player", "human", "--transcript", str(record)) as terminal:
        terminal.screen()
        terminal.type("1")
        terminal.screen()
        terminal.interrupt()
        printed = terminal.rest()
        assert LEAVE in printed
        assert terminal.code() == 130
    result = printed.rpartition(LEAVE)[2]
    assert re.search(r"end +│ closed", result), "what was played counts, and is shown"
    assert "1 in 1 turns" in result
    assert sp.read_transcript(record)[-1]["result"]["end_reason"] == "closed"


@pytest.mark.slow
def test_a_run_with_a_person_stops_when_the_person_leaves(tmp_path):
    out = tmp_path / "run"
    with Terminal("eval", "--games", HANOI, "--players", "human", "--trials", "3", "--out", str(out)) as terminal:
        for answer in ("2", "1", "6", "2", "3", "4", "2"):  # the whole first episode
            terminal.screen()
            terminal.type(answer)
        second = terminal.screen()
        terminal.type("q")
        printed = terminal.rest()
        assert terminal.code() == 1
    assert "rod" not in second.partition("1. Move")[0]  # a new episode, and nothing of the one before
    assert "episodes are not finished" in printed
    assert "━" not in printed  # no bars over the game
    (row,) = RunFolder(out).rows()
    assert (row["steps"], row["completed"], row["player"]) == (7, True, "human")
    assert RunFolder(out).failures() == [], "nothing was played in the second episode, so there is nothing to keep"
