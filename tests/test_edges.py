"""Edge cases of an episode: odd replies, aliases, interruptions, and answers in the wrong order."""

from __future__ import annotations

import asyncio
import json
import pickle
import threading
import time
from pathlib import Path

import pytest

import smartplay_tools as sp
from smartplay_tools.errors import TranscriptError
from smartplay_tools.records import sent_prompts

RPS, HANOI = "RockPaperScissorBasic-v0", "Hanoi3Disk-v0"
WEB = sp.ToolSpec("web", "Search.", {"type": "object", "properties": {"query": {"type": "string", "description": "q"}}})


def calling(*calls: tuple[str, str, str], say: str | None = None) -> dict:
    listed = [{"id": i, "type": "function", "function": {"name": n, "arguments": a}} for i, n, a in calls]
    return {"role": "assistant", "content": say, **({"tool_calls": listed} if listed else {})}


def acting(action: str = "Rock", call_id: str = "c") -> dict:
    return calling((call_id, "act", json.dumps({"action": action})))


class TestIds:
    """The core alone keeps call ids unique."""

    def test_an_id_that_looks_like_a_given_one_is_not_given_again(self):
        conversation = sp.Conversation(sp.Episode(RPS, seed=1, budget=sp.Budget(tool_calls=None)))
        conversation.receive(calling(("", "observe", "")))
        taken = conversation.latest_turn.calls[0].id
        conversation.receive(calling((taken, "observe", ""), ("c00001000", "observe", ""), ("", "observe", "")))
        ids = [call.id for turn in conversation.turns for call in turn.calls]
        assert len(set(ids)) == 4


class TestAliases:
    """Objects that a caller still holds cannot change the conversation."""

    def test_of_the_head(self):
        head = [{"role": "user", "content": "short"}]
        conversation = sp.Conversation(sp.Episode(RPS, seed=1), head=head)
        head[0]["content"] = "edited"
        assert "edited" not in str(conversation.prompt().messages)


class TestHostMessages:
    """Messages of a host are validated when they are added; an error is one sentence."""

    @pytest.mark.parametrize(
        ("message", "sentence"),
        [
            ({"role": "user", "content": [{"type": "image_url", "image_url": {"url": "x"}}]}, "text only"),
            ({"role": "user"}, "needs `content`"),
            ({"role": "user", "content": 5}, "Expected text or a list"),
            ({"role": "user", "content": "a", "name": 5}, "`name` of a message is text"),
            ({"role": "user", "content": "a", "weight": 5}, "has no field weight"),
            ({"role": "assistant", "content": "a"}, "has the role system, developer, user or tool"),
            ({"role": "system", "content": "a"}, "user messages and tool results only"),
            ({"role": "tool", "tool_call_id": "zz", "content": "a"}, "No call with the id 'zz' waits"),
            ("hello", "A message is a mapping"),
        ],
    )
    def test_after_a_reply(self, message, sentence):
        conversation = sp.Conversation(sp.Episode(RPS, seed=1))
        conversation.receive(acting())
        with pytest.raises(sp.InvalidArgumentError, match=sentence):
            conversation.add(message)
        assert conversation.prompt() is not None

    def test_a_user_message_may_not_stand_between_a_call_and_its_result(self):
        conversation = sp.Conversation(sp.Episode(RPS, seed=1), foreign_tools=[WEB])
        conversation.receive(calling(("x", "web", "{}")))
        with pytest.raises(sp.InvalidArgumentError, match="need their results before a user message"):
            conversation.add({"role": "user", "content": "Go on."})

    @pytest.mark.parametrize(
        ("head", "sentence"),
        [
            ([calling(("a", "act", "{}"))], "need results right after them"),
            ([calling(("a", "act", "{}")), {"role": "user", "content": "x"}], "need results right after them"),
            ([{"role": "tool", "tool_call_id": "a", "content": "x"}], "waits for this result"),
            ([calling(("", "act", "{}"))], "an id of its own"),
            ([{"role": "user", "content": None}], "needs `content`"),
        ],
    )
    def test_in_the_head(self, head, sentence):
        with pytest.raises(sp.InvalidArgumentError, match=sentence):
            sp.Conversation(sp.Episode(RPS, seed=1), head=head)

    def test_examples_of_calls_in_the_head_are_shown_recorded_and_replayed(self, tmp_path):
        example = [
            {"role": "user", "content": "An example:"},
            calling(("e1", "act", '{"action":"Rock"}')),
            {"role": "tool", "tool_call_id": "e1", "content": "You tied."},
        ]
        path = tmp_path / "few-shot.jsonl"
        with sp.Episode(RPS, seed=1, transcript=path) as episode:
            conversation = sp.Conversation(episode, head=example)
            assert conversation.prompt().messages[2:] == example
            conversation.receive(acting(call_id="e1"))
            assert conversation.latest_turn.calls[0].id != "e1", "the head's ids are taken"
            conversation.prompt()
        assert sp.replay(path).identical
        assert all(one.sha256 == one.recorded_sha256 for one in sent_prompts(sp.read_transcript(path)))


ODD = [
    "Rock",
    {**acting(), "name": 5},
    {**acting(), "extra": object()},
    {"role": "assistant", "content": 5},
    {"role": "assistant", "content": None, "tool_calls": [None]},
    {"role": "assistant", "content": None, "tool_calls": [{"function": "act"}]},
    {"role": "assistant", "content": None, "tool_calls": "act"},
    {"role": "assistant", "content": None, "provider_items": "x"},
    {"role": "user", "content": "x"},
    None,
]


class TestOddReplies:
    """A reply is validated before it is recorded."""

    @pytest.mark.parametrize("reply", ODD)
    def test_receive_refuses_them_and_nothing_has_happened(self, reply):
        events: list = []
        conversation = sp.Conversation(sp.Episode(RPS, seed=1, transcript=events))
        conversation.prompt()
        before = len(events)
        for receive in (conversation.receive, lambda reply: asyncio.run(conversation.areceive(reply))):
            with pytest.raises(ValueError):  # noqa: PT011 - the sentences are the point of other tests
                receive(reply)
        with pytest.raises(sp.InvalidArgumentError, match="usage"):
            conversation.receive(sp.Reply(acting(), {}))
        assert len(events) == before
        assert conversation.receive(acting())[0].data["step"] == 1

    @pytest.mark.parametrize("reply", [*(sp.Reply(odd) for odd in ODD), sp.Reply(acting(), usage={}), "Rock"])
    def test_in_play_they_are_the_players_error_and_the_record_replays(self, reply, tmp_path):
        class Odd:
            name = "odd"

            def reply(self, prompt: sp.Prompt) -> sp.Reply:
                return reply

        path = tmp_path / "odd.jsonl"
        with sp.Episode(RPS, seed=1, transcript=path) as episode:
            assert sp.play(episode, Odd()).end_reason == "player_error"
        assert sp.replay(path).identical

    def test_reasoning_in_pieces_is_kept_as_the_providers(self):
        conversation = sp.Conversation(sp.Episode(RPS, seed=1))
        conversation.receive({**acting(), "reasoning_content": [{"text": "Hm."}]})
        assert conversation.latest_turn.assistant["provider_items"] == [{"reasoning_content": [{"text": "Hm."}]}]

    def test_halves_of_a_character_become_the_character(self, tmp_path):
        path = tmp_path / "halves.jsonl"
        with sp.Episode(RPS, seed=1, transcript=path, tokenizer="approximate") as episode:
            conversation = sp.Conversation(episode)
            conversation.receive({**acting(), "content": "\ud83d" + "\ude00"})
            conversation.prompt()
            assert conversation.latest_turn.assistant["content"] == "😀"
        assert sp.replay(path).identical


def test_the_nesting_limit_does_not_depend_on_the_callers_stack():
    def deep(levels: int, arguments: str) -> str:
        if levels:
            return deep(levels - 1, arguments)
        with sp.Episode(RPS, seed=1, tokenizer="approximate") as episode:
            return episode.call("observe", arguments).text

    for levels in (90, 100, 101, 900):
        arguments = '{"a":' * levels + "1" + "}" * levels
        assert deep(0, arguments) == deep(700, arguments)
    assert "nested too deep" in deep(0, arguments)


class TestInterruptions:
    """Whatever interrupts an episode, its record replays and its game is closed."""

    def test_a_close_from_another_thread_waits_for_the_turn(self, tmp_path):
        path = tmp_path / "closed.jsonl"
        episode = sp.Episode(RPS, seed=1, transcript=path, tokenizer="approximate")
        conversation = sp.Conversation(episode)
        entered = slowed(episode)
        calls = [(f"{at}", "act", '{"action": "1"}') for at in range(4)]
        worker = threading.Thread(target=conversation.receive, args=(calling(*calls),))
        worker.start()
        entered.wait()
        episode.close()
        worker.join()
        assert episode.result.steps == 4
        assert sp.replay(path).identical

    def test_an_interruption_inside_a_step_leaves_a_record_without_an_end(self, tmp_path):
        path = tmp_path / "inside.jsonl"
        episode = sp.Episode(RPS, seed=1, transcript=path)
        conversation = sp.Conversation(episode)
        conversation.receive(acting())
        advance = episode.game.advance

        def interrupted(action: int) -> None:
            advance(action)
            raise KeyboardInterrupt

        episode.game.advance = interrupted
        with pytest.raises(KeyboardInterrupt), episode:
            conversation.receive(acting())
        replayed = sp.replay(path)
        assert not replayed.differences
        assert not replayed.complete
        with sp.resume(path) as resumed:
            assert sp.play(resumed.conversation, sp.get_player("rule")).steps == 50
        assert sp.replay(path).identical

    def test_a_full_disk_ends_the_record_and_closes_the_game(self, tmp_path):
        episode = sp.Episode(RPS, seed=1, transcript=tmp_path / "full.jsonl")
        episode.ledger.writer._file.close()
        episode.ledger.writer._file = Path("/dev/full").open("wb", buffering=0)  # noqa: SIM115 - the episode closes it
        closed = []
        episode.game.close = lambda: closed.append(True)
        with pytest.raises(TranscriptError, match=r"full\.jsonl can no longer be written: No space left"), episode:
            episode.call("act", {"action": "1"})
        assert closed

    def test_a_cancelled_aplay_leaves_a_record_that_replays(self, tmp_path):
        class Player:
            name = "many"

            async def areply(self, prompt: sp.Prompt) -> sp.Reply:
                return sp.Reply(calling(*[(f"{at}", "act", '{"action": "1"}') for at in range(3)], say="x" * 30_000))

        async def cancel(path, seconds: float) -> None:
            with sp.Episode(RPS, seed=1, transcript=path, tokenizer="approximate") as episode:
                task = asyncio.ensure_future(sp.aplay(episode, Player()))
                await asyncio.sleep(seconds)
                task.cancel()
                await asyncio.gather(task, return_exceptions=True)

        for number in range(0, 8, 2):
            path = tmp_path / f"{number}.jsonl"
            asyncio.run(cancel(path, number / 400))
            assert not sp.replay(path).differences


def slowed(episode: sp.Episode) -> threading.Event:
    """Make the steps of an episode slow; the event is set when one has begun."""
    advance, begun = episode.game.advance, threading.Event()

    def slow(action: int):
        begun.set()
        time.sleep(0.1)
        return advance(action)

    episode.game.advance = slow
    return begun


class TestConcurrency:
    def test_closing_while_calls_wait_answers_them(self):
        async def play() -> list[sp.ToolResult]:
            with sp.Episode(RPS, seed=1, tokenizer="approximate") as episode:
                calls = [asyncio.ensure_future(episode.acall("act", {"action": "1"})) for _ in range(20)]
                threading.Thread(target=episode.close).start()
                return await asyncio.gather(*calls)

        for _ in range(3):
            assert len(asyncio.run(play())) == 20

    def test_slow_steps_of_many_episodes_wait_at_the_same_time(self):
        async def play(episodes: list[sp.Episode]) -> float:
            for episode in episodes:
                episode.game.advance = lambda action, advance=episode.game.advance: time.sleep(0.2) or advance(action)
            began = time.perf_counter()
            await asyncio.gather(*(episode.acall("act", {"action": "1"}) for episode in episodes))
            return time.perf_counter() - began

        episodes = [sp.Episode(RPS, seed=seed, tokenizer="approximate") for seed in range(8)]
        assert asyncio.run(play(episodes)) < 8 * 0.2 / 2
        assert [episode.stats.steps for episode in episodes] == [1] * 8

    def test_a_call_that_is_cancelled_while_it_waits_is_not_played(self):
        async def play(episode: sp.Episode) -> int:
            begun = slowed(episode)
            first, second, third = [asyncio.ensure_future(episode.acall("act", {"action": "1"})) for _ in range(3)]
            await asyncio.to_thread(begun.wait)
            second.cancel()
            assert (await third).data["step"] == 2
            assert second.cancelled()
            return (await first).data["step"]

        with sp.Episode(RPS, seed=1, tokenizer="approximate") as episode:
            assert asyncio.run(play(episode)) == 1
            assert episode.stats.steps == 2

    def test_an_event_loop_that_ends_while_a_call_is_played_leaves_the_episode_usable(self):
        async def leave(episode: sp.Episode) -> None:
            begun = slowed(episode)
            call = asyncio.ensure_future(episode.acall("act", {"action": "1"}))
            await asyncio.to_thread(begun.wait)
            call.cancel()

        with sp.Episode(RPS, seed=1, tokenizer="approximate") as episode:
            asyncio.run(leave(episode))
            again = asyncio.run(episode.acall("act", {"action": "1"}))
            assert again.data["step"] == 2

    def test_many_episodes_share_few_threads(self):
        async def play() -> int:
            episodes = [sp.Episode(RPS, seed=seed, tokenizer="approximate") for seed in range(200)]
            await asyncio.gather(*(episode.acall("act", {"action": "1"}) for episode in episodes))
            return sum(thread.name.startswith("smartplay") for thread in threading.enumerate())

        assert asyncio.run(play()) <= 16


def test_an_end_needs_a_reason_that_there_is():
    with sp.Episode(RPS, seed=1) as episode:
        with pytest.raises(sp.InvalidArgumentError, match="The reason of an end must be one of"):
            episode.end("tired")
        episode.end("host", detail="message_limit")
    assert (episode.result.end_reason, episode.result.detail) == ("host", "message_limit")


def test_an_episode_cannot_be_pickled_and_says_what_can():
    with sp.Episode(RPS, seed=1) as episode:
        with pytest.raises(TypeError, match="pickle its `config`"):
            pickle.dumps(episode)
        config = pickle.loads(pickle.dumps(episode.config))
        with sp.Episode.from_config(config) as again:
            assert again.game.state_hash() == episode.game.state_hash()


class TestTokenizersOfRecords:
    """A record that was counted with a tokenizer object of yours replays only with that object."""

    class Letters:
        def __init__(self, name: str = "letters") -> None:
            self.name = name

        def count(self, text: str) -> int:
            return len(text)

    def test_an_object_of_yours(self, tmp_path):
        path = tmp_path / "letters.jsonl"
        with sp.Episode(RPS, seed=1, tokenizer=self.Letters(), transcript=path) as episode:
            sp.play(episode, sp.get_player("rule"))
        assert sp.replay(path, tokenizer=self.Letters()).identical
        with pytest.raises(sp.InvalidArgumentError, match=r"tokenizer 'letters'.*in Python tokenizer="):
            sp.replay(path)
        with pytest.raises(sp.InvalidArgumentError, match="was counted with the tokenizer 'letters'"):
            sp.replay(path, tokenizer=self.Letters("others"))
