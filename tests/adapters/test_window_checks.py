"""What the window endpoint checks of a request, by interface: each of the three refuses and forgives the same."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pytest
from smartplay_gateway.window.app import FORMATS
from smartplay_gateway.window.formats import CompletionRequest, HostFormat

from tests.adapters.conformance import WAY, act, calling
from tests.adapters.window_host import INTERFACES, TOOLS, client_of, scripted

SCHEMA = {"type": "object", "properties": {"city": {"type": "string"}}}
TOOL = {"name": "weather", "description": "Tell the weather.", "schema": SCHEMA}
NAMED = "A tool has a name|A tool's name has"

Tools = list[Any]
CHECKS: Mapping[str, tuple[Any, Tools, str | None]] = {
    "no messages": (None, [TOOL], None),
    "messages as one text": ("Play.", [TOOL], None),
    "a message that is no object": (["Play."], [TOOL], None),
    "messages that are a number": (7, [TOOL], "is a text or a list"),
    "no tools": ([], [], None),
    "a tool that is no object": ([], ["weather"], NAMED),
    "a tool without a name": ([], [{"schema": SCHEMA}], NAMED),
    "a tool whose name is empty": ([], [{**TOOL, "name": ""}], NAMED),
    "a tool whose name is a number": ([], [{**TOOL, "name": 7}], NAMED),
    "a tool by a name that providers refuse": ([], [{**TOOL, "name": "go north!"}], None),
    "a tool by a long name": ([], [{**TOOL, "name": "n" * 100}], None),
    "two tools with one name": ([], [TOOL, TOOL], "Two tools have the name weather"),
    "a tool without a schema": ([], [{"name": "weather"}], None),
    "a schema without a type": ([], [{**TOOL, "schema": {"properties": {}}}], None),
    "a schema of a list": ([], [{**TOOL, "schema": {"type": "array"}}], "JSON Schema of type object"),
    "a schema that is no object": ([], [{**TOOL, "schema": [1]}], "JSON Schema of type object"),
    "properties that are a list": ([], [{**TOOL, "schema": {"type": "object", "properties": [1]}}], "properties are"),
    "required that is a number": ([], [{**TOOL, "schema": {**SCHEMA, "required": 7}}], "list of their names"),
    "a strict tool that is open": ([], [{**TOOL, "strict": True}], None),
}
"""For each check the messages, the tools, and with which words they are refused; None if they are forgiven."""


def body_of(form: HostFormat, messages: Any, tools: Any, **fields: Any) -> dict[str, Any]:
    """A request in the words of an interface."""
    offered = [in_words_of(form, tool) for tool in tools] if isinstance(tools, list) else tools
    field = "input" if form.path.endswith("responses") else "messages"
    return {"model": "m", "tools": offered, **({} if messages is None else {field: messages}), **fields}


def in_words_of(form: HostFormat, tool: Any) -> Any:
    if not isinstance(tool, dict):
        return tool
    described = {name: value for name, value in tool.items() if name != "schema"}
    if form.path.endswith("messages"):
        return described | ({"input_schema": tool["schema"]} if "schema" in tool else {})
    described |= {"parameters": tool["schema"]} if "schema" in tool else {}
    is_chat = form.path.endswith("completions")
    return {"type": "function", "function": described} if is_chat else {"type": "function", **described}


each_interface = pytest.mark.parametrize("form", FORMATS, ids=lambda form: form.path)


@each_interface
@pytest.mark.parametrize("check", CHECKS)
def test_an_interface_refuses_and_forgives_what_the_others_do(check, form):
    messages, tools, refusal = CHECKS[check]
    if refusal is not None:
        with pytest.raises(Exception, match=refusal):
            form.read(body_of(form, messages, tools))
        return
    request: CompletionRequest = form.read(body_of(form, messages, tools))
    assert [tool.name for tool in request.tools] == [tool["name"] for tool in tools]
    assert request.left_out == []


@each_interface
def test_the_rest_is_alike_too(form):
    with pytest.raises(Exception, match="tools is a list"):
        form.read(body_of(form, [], "weather"))
    assert "n" in form.read(body_of(form, [], [], n=2)).ignored.fields, "named as what has no effect"


@pytest.mark.parametrize("interface", INTERFACES)
def test_a_name_that_providers_refuse_is_shown_as_one_they_take(interface):
    endpoint, player = scripted(calling(("go_north_", {"city": "Bern"})), calling(act(WAY[0])))
    tool = {"type": "function", "function": {"name": "go north!", "description": "Go.", "parameters": SCHEMA}}
    with endpoint, client_of(interface, endpoint) as client:
        asks = INTERFACES[interface](client, endpoint.model(endpoint.open("Hanoi3Disk-v0", seed=7)), False)
        answer = asks.ask([*asks.begin], [*TOOLS, tool])
    assert [call[1:] for call in answer.calls] == [("go north!", {"city": "Bern"})]
    assert player.prompts[0].tools[-1].name == "go_north_"
