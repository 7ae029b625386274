"""Draw what prompts show under several strategies: the turns of a prompt, and the parts of every prompt.

Under one cap and on one seed the same player plays with each strategy. The figures are made of the records alone.
"""

from pathlib import Path

import smartplay_tools as sp
from smartplay_tools.evaluation.analysis.figures.prompt_figures import prompt_rows, tokens_by_part
from smartplay_tools.evaluation.analysis.figures.style import save_figure
from smartplay_tools.records import Record

CAP = sp.Budget(prompt_tokens=950, history=6, tool_calls=17)
FEW = {
    "dropping": CAP,
    "masking": CAP.model_copy(update={"beyond_history": "mask"}),
    "notes": CAP.model_copy(update={"notes_tokens": 50}),
    "a summary": CAP.model_copy(update={"summary_tokens": 60, "slack": 0.5}),
    "calls alone": CAP.model_copy(update={"own_words": 2}),
    "first turns": CAP.model_copy(update={"first_turns": 2}),
}
SLIDING = sp.Budget(history=10, prompt_tokens=1000, slack=0.5)
WHOLE = {
    "drop": SLIDING,
    "mask": SLIDING.model_copy(update={"beyond_history": "mask"}),
    "notes": SLIDING.model_copy(update={"notes_tokens": 200}),
    "summary": SLIDING.model_copy(update={"summary_tokens": 100}),
}


class Speaker:
    """Says a sentence with every move, and takes notes once."""

    name = "speaker"
    turns = 0

    def reply(self, prompt: sp.Prompt) -> sp.Reply:
        if prompt.purpose != "play":
            return sp.Reply({"role": "assistant", "content": "The opponent likes Rock."})
        self.turns += 1
        if self.turns == 5 and "take_notes" in {tool.name for tool in prompt.tools}:
            return sp.Reply(sp.call("take_notes", text="The opponent likes Rock."))
        return sp.Reply(sp.call("act", say="I think that Paper wins against what comes next.", action="Paper"))


def played(game: str, budget: sp.Budget, player: sp.Player, path: Path) -> Record:
    """Play an episode, and read its record."""
    with sp.Episode(game, seed=3, budget=budget, transcript=path) as episode:
        sp.play(episode, player)
    return Record.read(path)


if __name__ == "__main__":
    game = "RockPaperScissorBasic-v0"
    rows = [(name, played(game, way, Speaker(), Path(f"few-{name}.jsonl")), 16) for name, way in FEW.items()]
    save_figure(prompt_rows(rows), "one-prompt", formats=["png"])
    rows = []
    for slack in (0.0, 0.5):
        budget = sp.Budget(prompt_tokens=600, slack=slack)
        record = played(game, budget, sp.get_player("rule"), Path(f"slack-{slack}.jsonl"))
        rows += [(f"slack {slack:g}, prompt {turn}", record, turn) for turn in range(9, 13)]
    save_figure(prompt_rows(rows), "window", formats=["png"])
    game, notes = "RockPaperScissorDifferentScore-v0", "rule-notes"
    records = {
        name: played(game, way, sp.get_player(notes, words=False), Path(f"whole-{name}.jsonl"))
        for name, way in WHOLE.items()
    }
    save_figure(tokens_by_part(records), "where-tokens-went", formats=["png"])
    print("one-prompt.png, window.png and where-tokens-went.png are here, and the records that they show.")
