"""The directive `all-examples`: every program in `examples/`, whole, in the order of their numbers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

EXAMPLES = Path(__file__).parents[2] / "examples"


TITLES = {
    "01_play_under_a_budget": "Play a game under a token budget",
    "02_openai_chat_completions": "Call OpenAI's chat completions in a loop of your own",
    "03_openai_player": "Let a model behind OpenAI's interface play",
    "04_openai_responses": "Call OpenAI's Responses interface in a loop of your own",
    "05_openai_many_games_at_once": "Play many games at once with one client",
    "06_budget_sweep": "Measure what a smaller context costs",
    "07_draw_what_prompts_show": "Draw what prompts show under several strategies",
    "10_langchain_agent": "Play with a LangChain agent",
    "11_langgraph": "Play with a LangGraph graph",
    "12_agents_sdk": "Play with OpenAI's Agents SDK",
    "13_anthropic": "Call Anthropic's client in a loop of your own",
    "14_mcp_client": "Play over the Model Context Protocol",
    "15_evaluate_agents": "Evaluate agents of LangChain and of OpenAI's Agents SDK",
    "16_evaluate_pydantic_ai": "Evaluate an agent of Pydantic AI",
    "20_train_a_tiny_agent": "Train a tiny agent on a laptop",
    "tiny_agent": "The tiny agent of the program above",
}
"""What people would call the examples."""


class AllExamples(SphinxDirective):
    """A section for each example, which says itself what it is."""

    def run(self) -> list[nodes.Node]:
        """Return the sections."""
        self.env.note_reread()
        text = "\n\n".join(map(_section, sorted(EXAMPLES.glob("*.py"))))
        return self.parse_text_to_nodes(text, allow_section_headings=True)


def _section(path: Path) -> str:
    title = TITLES.get(path.stem) or " ".join(path.stem.split("_")).capitalize()
    program = f"```{{literalinclude}} ../examples/{path.name}\n:language: python\n```"
    return f"### {title}\n\n`examples/{path.name}`\n\n{program}"


def setup(app: Sphinx) -> dict[str, Any]:
    """Called by Sphinx."""
    app.add_directive("all-examples", AllExamples)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
