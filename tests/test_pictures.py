"""Pictures as observations: their bytes, their tokens, what a prompt and a record hold of them, who may see them."""

from __future__ import annotations

import json
import random
from collections import Counter

import gymnasium
import numpy as np
import pytest
from gymnasium.wrappers import AddRenderObservation

import smartplay_tools as sp
from smartplay_tools.context.tokens import TokenCounter, get_tokenizer
from smartplay_tools.context.tokens.pictures import RULES
from smartplay_tools.episode import GameTools, cell_config
from smartplay_tools.errors import TranscriptError, UnknownNameError
from smartplay_tools.evaluation.costs.tariffs import charge_records, tariffs_of
from smartplay_tools.evaluation.run_folder.folder import RunFolder
from smartplay_tools.evaluation.runs.estimate import estimate_cell
from smartplay_tools.evaluation.runs.sweeps import grid
from smartplay_tools.games.crafter.pictures import draw
from smartplay_tools.games.minecraft import pictures as minecraft
from smartplay_tools.games.minecraft.voxel import animals
from smartplay_tools.games.minecraft.voxel.blocks import NAMES
from smartplay_tools.players.scripted import RandomPlayer
from smartplay_tools.records import Record, recorded_pictures, replay, sent_prompts
from smartplay_tools.records.accounts import Accounts
from smartplay_tools.types.messages import pictures_of, text_of
from smartplay_tools.types.pictures import Picture
from tests import fuzz, scripts
from tests.games.test_minecraft_text import nothing, see
from tests.test_conversation import acting, calling

SHOWN = "The picture shows the current observation."


def noise(rows: int, columns: int) -> np.ndarray:
    """Pixels that need no random generator, so that they are the same everywhere."""
    numbers = np.arange(rows * columns * 3, dtype=np.uint64) * 2654435761 % 2**32 >> 24
    return numbers.astype(np.uint8).reshape(rows, columns, 3)


def played(steps: int = 12, game: str = "Crafter-v0", **options):
    """The events of an episode that the random player plays, cut off after some steps."""
    events = []
    budget = sp.Budget(**{"tool_calls": steps, **options.pop("budget", {})})
    episode = sp.Episode(game, seed=3, budget=budget, transcript=events, **options)
    sp.play(episode, RandomPlayer())
    return events


# Pixels, their digest and their file.


@pytest.mark.parametrize(
    ("rows", "columns", "scale", "sha256"),
    [
        (63, 63, 4, "da541e2cf7ef66660db6aa4836e6ecfaa6f5d9cf3a33f19a4a74b3fdeb1d7341"),
        (17, 17, 12, "9ad54ab200137e1809f4aa65c656ac36a595d3d838566151b6425cf7f374f6d1"),
        (3, 2, 1, "b7867242f67b8588963ab24de9fc343bb04c99577ac621603c8985650c366b8d"),
    ],
)
def test_a_picture_has_the_same_digest_on_every_platform(rows, columns, scale, sha256):
    assert Picture.from_array(noise(rows, columns), scale).sha256 == sha256


@pytest.mark.parametrize("scale", [1, 2, 4, 12])
@pytest.mark.parametrize(("rows", "columns"), [(63, 63), (1, 1), (2, 31), (7, 100)])
def test_its_file_is_read_as_its_pixels_enlarged(rows, columns, scale):
    pixels = noise(rows, columns)
    picture = Picture.from_array(pixels, scale)
    assert np.array_equal(scripts.pixels_of(picture.png), pixels.repeat(scale, 0).repeat(scale, 1))
    assert (picture.width, picture.height) == (columns * scale, rows * scale)
    assert picture.sha256 == scripts.picture_digest(picture.png)


# Tokens.


@pytest.mark.parametrize("rule", RULES.values(), ids=RULES)
def test_a_rule_counts_the_examples_of_its_source(rule):
    assert rule.examples
    for width, height, tokens in rule.examples:
        assert TokenCounter(f"approximate+{rule.name}").image(width, height) == tokens
    assert rule.source.startswith("https://")


def test_the_rule_is_part_of_the_tokenizer():
    tokenizer = get_tokenizer("o200k_base+openai-tiles")
    assert tokenizer.name == "o200k_base+openai-tiles"
    assert tokenizer.sha256 == get_tokenizer().sha256
    assert TokenCounter(tokenizer).text("Move North") == TokenCounter().text("Move North")
    assert TokenCounter(tokenizer).image(252, 252) == 255


def test_an_unknown_rule_is_named():
    with pytest.raises(UnknownNameError, match=r"rule for pictures 'claude-29'; did you mean claude-28"):
        get_tokenizer("o200k_base+claude-29")


def test_words_are_not_counted_as_pictures_without_a_rule():
    with pytest.raises(sp.InvalidArgumentError, match=r"name a rule with it: o200k_base\+claude-28"):
        TokenCounter().image(252, 252)


def test_a_tokenizer_of_yours_may_count_pictures_itself():
    class Own(scripts.Words):
        name = "own"

        def image(self, width, height):
            return 7

    with sp.Episode("Crafter-v0", seed=1, observation="picture", tokenizer=Own()) as episode:
        assert episode.config.tokenizer == "own"
        assert episode.counter.image(252, 252) == 7


# An episode.


@pytest.mark.parametrize(("form", "beside"), [("picture", SHOWN), ("both", "You took action noop.")])
def test_a_result_shows_the_picture_of_its_observation(form, beside):
    with sp.Episode("Crafter-v0", seed=1, observation=form) as episode:
        assert episode.config.tokenizer == "o200k_base+claude-28"
        result = episode.call("act", {"action": "Noop"})
        assert result.text.startswith(beside)
        assert result.picture == episode.game.picture()
        assert result.data["picture"] == {"sha256": result.picture.sha256, "width": 252, "height": 252}
        assert episode.call("observe").picture == result.picture
        for mistake in (episode.call("act", {"action": "Fly"}), episode.call("jump"), episode.call("read_manual")):
            assert mistake.picture is None
            assert "picture" not in mistake.data


def test_crafters_picture_is_the_originals_enlarged_fourfold():
    with sp.Episode("Crafter-v0", seed=1, observation="picture") as episode:
        for action in ("Noop", "Move West", "Do"):
            picture = episode.call("act", {"action": action}).picture
        original = draw(episode.game._world.scene())[:63, :63]
        assert np.array_equal(scripts.pixels_of(picture.png), original.repeat(4, 0).repeat(4, 1))


@pytest.mark.parametrize(
    ("size", "side"),
    [
        (64, 252),
        *(pytest.param(*each, marks=pytest.mark.slow) for each in [(90, 180), (126, 252), (252, 252), (300, 297)]),
    ],
)
def test_picture_size_gives_finer_textures(size, side):
    with sp.Episode("Crafter-v0", seed=1, observation="picture", picture_size=size) as episode:
        picture = episode.call("observe").picture
        assert (picture.width, picture.height) == (side, side)


def test_every_block_and_animal_of_minecraft_has_a_colour_of_its_own():
    assert set(minecraft.BLOCKS) == set(NAMES["corrected"].tolist())
    assert set(minecraft.ANIMALS) == set(animals.NAMES.tolist()) - {"null"}
    colours = [*minecraft.BLOCKS.values(), *minecraft.ANIMALS.values()]
    assert len(set(colours)) == len(colours)


def test_minecrafts_picture_has_the_sky_above_and_the_ground_below():
    with sp.Episode("MinedojoCreative0-v0", seed=3, observation="both") as episode:
        picture = episode.call("observe").picture
        pixels = minecraft.draw(episode.game._seen)
        assert (picture.width, picture.height) == (204, 204)
        assert episode.counter.image(204, 204) == 64
    sky = [(pixels[row] == minecraft.BLOCKS["air"]).all(axis=-1).sum() for row in (0, -1)]
    assert sky[0] > sky[1] == 0
    seen = nothing()
    see(seen, 8, 8, "stone", 32)
    # At 65 blocks a colour has 96 of 256 parts of its brightness, and here 178.
    assert minecraft.draw(seen)[8, 8].tolist() == [part * 178 // 256 for part in minecraft.BLOCKS["stone"]]


@pytest.mark.parametrize(("game", "form"), [("Crafter-v0", "both"), ("MinedojoCreative0-v0", "picture")])
def test_a_record_has_no_pictures_and_its_replay_makes_them_again(game, form):
    events = played(8, game, observation=form)
    assert "png" not in json.dumps(events)
    assert replay(events).identical
    pictures = recorded_pictures(events)
    shown = [event["data"]["picture"] for event in events if event["event"] == "call" and "picture" in event["data"]]
    assert len(shown) == 8
    for facts in shown:
        picture = pictures[facts["sha256"]]
        assert scripts.picture_digest(picture.png) == facts["sha256"]
        assert picture.facts == facts


def test_a_record_that_names_another_picture_is_found_out():
    events = played(3, observation="picture")
    [*_, last] = [event for event in events if event["event"] == "call"]
    last["data"]["picture"]["sha256"] = "0" * 64
    assert not replay(events).identical
    assert any("sha256" in difference for difference in replay(events).differences)
    with pytest.raises(TranscriptError, match="a picture that its game does not make here"):
        recorded_pictures(events)


def test_a_prompts_sha256_depends_on_its_pictures():
    shas = []
    for seed in (1, 2):  # two worlds, whose words here are the same
        events = []
        with sp.Episode("Crafter-v0", seed=seed, observation="picture", transcript=events) as episode:
            conversation = sp.Conversation(episode)
            conversation.prompt()
            conversation.receive(calling(("observe", "{}")))
            messages = conversation.prompt().messages
            assert text_of(messages[-1]) == SHOWN
        shas.append([event["sha256"] for event in events if event["event"] == "view"])
    assert shas[0][0] == shas[1][0]
    assert shas[0][1] != shas[1][1]


# Caps.


@pytest.mark.parametrize(("field", "least"), [("result_tokens", 81 + 12), ("prompt_tokens", None)])
def test_a_picture_that_does_not_fit_is_refused_when_the_episode_is_made(field, least):
    if least is None:
        with sp.Episode("Crafter-v0", seed=1) as episode:
            least = episode.counter.prompt(episode.head, episode.tools) + 81 + 12
    with pytest.raises(sp.InvalidArgumentError, match=f"{field}={least - 1} cannot hold an observation with a picture"):
        sp.Episode("Crafter-v0", seed=1, observation="picture", budget=sp.Budget(**{field: least - 1}))
    sp.Episode("Crafter-v0", seed=1, observation="picture", budget=sp.Budget(**{field: least})).close()


def test_auto_gives_a_result_the_room_of_its_picture_in_addition():
    caps = {}
    for form in ("text", "picture"):
        with sp.Episode("Crafter-v0", seed=1, observation=form, budget=sp.Budget(prompt_tokens=900)) as episode:
            caps[form] = episode.budget.result_tokens, episode.budget.manual_tokens
    assert caps["picture"] == (caps["text"][0] + 81, caps["text"][1])


def shown_as(message):
    """Whether a result of a prompt shows a picture, words or the marker."""
    marker = text_of(message) == "[observation left the history window]"
    return "picture" if pictures_of(message) else "marker" if marker else "words"


@pytest.mark.parametrize(
    ("form", "budget", "expected"),
    [
        ("both", {"newest_pictures": 2}, "words words words picture picture"),
        ("picture", {"newest_pictures": 2}, "marker marker marker picture picture"),
        ("both", {"newest_pictures": 2, "history": 2, "beyond_history": "mask"}, "marker marker words picture picture"),
        ("both", {"newest_pictures": 4, "slack": 0.5}, "words words picture picture picture"),
    ],
)
def test_only_the_newest_pictures_are_shown(form, budget, expected):
    events = played(6, observation=form, budget=budget)
    assert replay(events).identical
    *_, last = sent_prompts(events, pictures=recorded_pictures(events))
    assert last.sha256 == last.recorded_sha256
    assert [shown_as(message) for message in last.prompt.messages if message["role"] == "tool"] == expected.split()
    assert len(last.prompt.pictures) <= budget["newest_pictures"]
    record = Record(events)
    assert [*map(sum, Accounts.of(record).prompts())] == [view["tokens"] for view in record.views]


def test_no_picture_is_kept_that_no_prompt_can_show():
    with sp.Episode("Crafter-v0", seed=3, observation="both", budget=sp.Budget(newest_pictures=2)) as episode:
        conversation = sp.Conversation(episode)
        for action in ("Noop", "Move West", "Move East", "Noop"):
            conversation.prompt()
            conversation.receive(acting(action))
        conversation.prompt()
        assert len(conversation.pictures) == 2


@pytest.mark.parametrize(
    ("form", "budget", "why"),
    [
        ("text", {"newest_pictures": 2}, 'where observations are words; use observation="both"'),
        ("picture", {"recall_tokens": 50, "prompt_tokens": 2_000}, "searches words"),
    ],
)
def test_what_does_nothing_in_this_form_is_refused(form, budget, why):
    with pytest.raises(sp.InvalidArgumentError, match=why):
        sp.Episode("Crafter-v0", seed=1, observation=form, budget=sp.Budget(**budget))


def test_a_sweep_leaves_out_pictures_of_words_and_keeps_the_rest():
    vary = {"observation": ["text", "both"], "newest_pictures": [None, 2]}
    drawn = grid(["Crafter-v0"], ["random"], vary=vary)
    played = [(cell.observation, cell.budget.newest_pictures) for cell in drawn.cells]
    assert sorted(played, key=str) == [("both", 2), ("both", None), ("text", None)]
    assert "newest_pictures has nothing to leave out" in drawn.left_out[0]


@pytest.mark.parametrize(
    ("form", "many"),
    [("both", 8), *(pytest.param(form, 100, marks=pytest.mark.slow) for form in ("picture", "both"))],
)
def test_prompts_with_pictures_are_judged(form, many):
    counts, number = Counter(), 0
    while counts["pictures in prompts"] < many:
        number += 1
        fuzz.hostile_conversation(random.Random(f"pictures {number}"), counts, form)


# Who may see them.


@pytest.mark.parametrize(
    ("game", "options", "why"),
    [
        ("Hanoi3Disk-v0", {}, "since it has no picture"),
        ("MessengerL1-v0", {}, "since it has no picture"),
        ("MinedojoCreative0-v0", {"engine": "minedojo"}, "since only its engine voxel draws pictures"),
        ("MinedojoCreative0-v0", {"text": "paper"}, "turned upside down"),
    ],
)
def test_a_game_without_pictures_is_refused_in_a_sentence(game, options, why):
    with pytest.raises(sp.InvalidArgumentError, match=why):
        sp.Episode(game, seed=1, observation="picture", **options)


def test_gymnasium_adds_a_picture_to_a_text_game_by_its_own_wrapper():
    with pytest.raises(
        sp.InvalidArgumentError, match=r"The observation of a text game is its text.*AddRenderObservation"
    ):
        gymnasium.make("smartplay_tools:smartplay/Hanoi3Disk-v0", observation="both")
    game = gymnasium.make("smartplay_tools:smartplay/Crafter-v0", render_mode="rgb_array")
    both = AddRenderObservation(game, render_only=False, render_key="picture", obs_key="text")
    both.reset(seed=3)
    seen, *_ = both.step(0)
    assert both.observation_space.contains(seen)
    assert np.array_equal(seen["picture"], game.render())
    assert seen["text"] == game.unwrapped.observation
    both.close()


def test_a_player_of_words_is_refused_before_its_first_reply():
    with (
        sp.Episode("Crafter-v0", seed=1, observation="picture") as episode,
        pytest.raises(sp.InvalidArgumentError, match=r"rule does not play from observation=\"picture\""),
    ):
        sp.play(episode, sp.get_player("rule"))


def test_a_run_is_refused_before_it_begins(tmp_path):
    with pytest.raises(sp.InvalidArgumentError, match="rule does not play from"):
        sp.evaluate(["Crafter-v0"], ["rule"], out=tmp_path / "run", trials=1, observation="picture")


def test_a_host_of_words_is_refused():
    with sp.Episode("Crafter-v0", seed=1, observation="both") as episode:
        with pytest.raises(sp.InvalidArgumentError, match="results in words only"):
            sp.AgentSession(episode)
        with pytest.raises(sp.InvalidArgumentError, match="results in words only"):
            episode.functions()
        with pytest.raises(sp.InvalidArgumentError, match="results in words only"):
            GameTools(episode)
        sp.AgentSession(episode, pictures=True)


# Before and after a run.


@pytest.mark.parametrize("form", [pytest.param("picture", marks=pytest.mark.slow), "both"])
def test_an_estimate_and_what_it_cost_count_pictures(tmp_path, form):
    """What is played lies within the estimate, and the cost has every token of the prompts on record."""
    budget = sp.Budget(tool_calls=30, history=5)
    cell = cell_config("Crafter-v0", player="random", budget=budget, observation=form)
    played = sp.evaluate(
        ["Crafter-v0"],
        ["random"],
        out=tmp_path / "run",
        trials=2,
        budgets=[budget],
        observation=form,
        executor="inline",
    )
    estimated = estimate_cell(cell, [row["seed"] for row in played.rows], None).prompt_tokens
    took = sum(row["tokens"]["prompt"] for row in played.rows)
    assert estimated.low <= took <= estimated.high
    assert took > 2 * 30 * 4 * 81  # four pictures and more in most prompts
    records = {row["key"]: RunFolder(tmp_path / "run").transcript(row["key"]) for row in played.rows}
    charged = charge_records(records, tariffs_of(["none"]))
    assert sum(cost[0].prompt for cost in charged.values()) == took
