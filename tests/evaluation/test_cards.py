"""Pictures to share: a card of a turn and an animation of turns, with what each prompt could see."""

from __future__ import annotations

import pytest
from typer.testing import CliRunner

import smartplay_tools as sp
from smartplay_tools.cli import app

Image = pytest.importorskip("PIL.Image")
cards = pytest.importorskip("smartplay_tools.evaluation.pages.cards")


def played(path, game, budget, **options):
    with sp.Episode(game, seed=3, budget=budget, transcript=path, **options) as episode:
        sp.play(episode, sp.get_player("random", seed=1))
    return path


def colours(path):
    """How many pixels of the context band each colour has."""
    with Image.open(path) as picture:
        band = picture.convert("RGB").crop((cards.MARGIN, 545, cards.SIZE[0] - cards.MARGIN, 570))
    pixels = band.getcolors(100_000)
    return {"#{:02x}{:02x}{:02x}".format(*colour): count for count, colour in pixels}


def test_a_card_shows_what_the_prompt_of_a_turn_could_see(tmp_path):
    record = played(tmp_path / "game.jsonl", "Hanoi3Disk-v0", sp.Budget(history=5))
    done = CliRunner().invoke(app, ["share", str(record), "--turns", "20", "--out", str(tmp_path / "card.png")])
    assert done.exit_code == 0, done.output
    with Image.open(tmp_path / "card.png") as card:
        assert card.size == cards.SIZE
    band = colours(tmp_path / "card.png")
    seen = band[cards.SEEN] / (band[cards.SEEN] + band[cards.GONE])
    shown = next(e for e in sp.read_transcript(record) if e["event"] == "view" and e["turn"] == 20)["turns"]
    assert seen == pytest.approx(sum(last - first + 1 for first, last in shown) / 20, abs=0.05)


@pytest.mark.slow
def test_turns_are_an_animation(tmp_path):
    record = played(tmp_path / "game.jsonl", "Crafter-v0", sp.Budget(history=2, tool_calls=6))
    done = CliRunner().invoke(app, ["share", str(record), "--turns", "2-4", "--out", str(tmp_path / "turns.gif")])
    assert done.exit_code == 0, done.output
    with Image.open(tmp_path / "turns.gif") as animation:
        assert (animation.n_frames, animation.info["duration"]) == (3, cards.FRAME_MILLISECONDS)


def test_turns_that_are_not_there_are_named(tmp_path):
    record = played(tmp_path / "game.jsonl", "Hanoi3Disk-v0", sp.Budget(tool_calls=3))
    for out, turns in (("card.png", "9"), ("turns.gif", "7-9")):
        done = CliRunner().invoke(app, ["share", str(record), "--turns", turns, "--out", str(tmp_path / out)])
        assert (done.exit_code, "turns 0 to 2" in done.output) == (2, True)


def test_observations_that_were_left_out_have_a_colour_of_their_own(tmp_path):
    budget = sp.Budget(history=2, beyond_history="mask")
    record = played(tmp_path / "game.jsonl", "Hanoi3Disk-v0", budget)
    cards.write_card(record, tmp_path / "card.png", turn=12)
    band = colours(tmp_path / "card.png")
    assert band[cards.MARKED] > 2 * band[cards.SEEN]
    assert cards.GONE not in band
