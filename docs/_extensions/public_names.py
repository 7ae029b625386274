"""The directives `public-names` and `all-adapters`: everything that a module offers, documented from its docstrings.

The list is the module's `__all__`, the adapters are the folders of `adapters/`, read when the site is built: what is
new appears by itself. Docstrings are written for people who read code: single backticks are code, not references.
"""

from __future__ import annotations

import ast
import importlib
import inspect
import re
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar, is_typeddict

from docutils import nodes
from docutils.parsers.rst import directives
from pydantic import BaseModel
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.ext.napoleon import Config, GoogleDocstring
from sphinx.pycode import ModuleAnalyzer
from sphinx.util.docutils import SphinxDirective

import smartplay_tools
from smartplay_tools.errors import MissingExtraError

ADAPTERS = Path(__file__).parents[2] / "adapters"

LONGEST_TYPE = 100
"""A type that is longer when it is spelled out (a union of a framework's messages) is shown as its author wrote it."""

INHERITED_MACHINERY = ("later", "metadata", "model_config", "model_post_init", "response_format")
"""What Gymnasium, pydantic and LangChain put into a class for themselves."""

KINDS: dict[str, Callable[[Any], bool]] = {
    "functions": lambda thing: inspect.isroutine(thing),
    "errors": lambda thing: inspect.isclass(thing) and issubclass(thing, Exception),
    "classes": lambda thing: inspect.isclass(thing) and not issubclass(thing, Exception),
    "data": lambda thing: not (inspect.isroutine(thing) or inspect.isclass(thing)),
}


NAPOLEON = Config(napoleon_use_ivar=True)


class PublicNames(SphinxDirective):
    """`public-names MODULE`: all of it, one `kind`, or the `names` that are listed, in their order, and where from."""

    required_arguments = 1
    option_spec: ClassVar = {
        "kind": lambda argument: directives.choice(argument, tuple(KINDS)),
        "names": directives.unchanged_required,
    }

    def run(self) -> list[nodes.Node]:
        """Return the documentation of the names."""
        module = importlib.import_module(self.arguments[0])
        belongs = KINDS.get(self.options.get("kind", ""), lambda thing: True)
        offered = public_names(module)
        asked = self.options.get("names", "").split() or offered
        if missing := set(asked) - set(offered):
            raise self.error(f"{module.__name__} does not offer {', '.join(sorted(missing))}.")
        described = [name for name in asked if belongs(getattr(module, name))]
        begin = [f"From ``{module.__name__}``:"] if "names" in self.options else []
        text = "\n\n".join([*begin, *(_describe(module, name) for name in described)])
        return self.parse_text_to_nodes(f"```{{eval-rst}}\n{text}\n```")


class AllAdapters(SphinxDirective):
    """A section for each adapter: what it says of itself first, and its public names.

    An adapter whose framework is not installed where the site is built has its first line only.
    """

    def run(self) -> list[nodes.Node]:
        """Return the sections."""
        here = importable()
        text = "\n\n".join(
            f"## {name}\n\n{_first_line(name)}" + (f"\n\n```{{public-names}} {name}\n```" if name in here else "")
            for name in adapters()
        )
        return self.parse_text_to_nodes(text, allow_section_headings=True)


def adapters() -> list[str]:
    """The packages of the adapters."""
    return sorted(folder.name for folder in ADAPTERS.glob("smartplay_*"))


def importable() -> list[str]:
    """The adapters whose framework is installed."""
    names = []
    for name in adapters():
        with suppress(MissingExtraError):
            module = importlib.import_module(name)
            for offered in public_names(module):  # those of a lazy package are imported when they are asked for
                getattr(module, offered)
            names.append(name)
    return names


def _first_line(adapter: str) -> str:
    source = (ADAPTERS / adapter / "__init__.py").read_text(encoding="utf-8")
    return (ast.get_docstring(ast.parse(source)) or "").partition("\n")[0]


def public_names(module: ModuleType) -> list[str]:
    """What a module offers: `__all__`, or where there is none what it defines itself without an underscore."""
    own = (name for name, thing in vars(module).items() if getattr(thing, "__module__", None) == module.__name__)
    return list(getattr(module, "__all__", None) or [name for name in own if not name.startswith("_")])


def _describe(module: ModuleType, name: str) -> str:
    thing = getattr(module, name)
    if (
        name in public_names(smartplay_tools)
        and thing is getattr(smartplay_tools, name)
        and module is not smartplay_tools
    ):
        return f":py:obj:`smartplay_tools.{name}`, under this name too."
    if KINDS["functions"](thing):
        return f".. autofunction:: {module.__name__}.{name}"
    if KINDS["errors"](thing):
        return f".. autoexception:: {module.__name__}.{name}\n   :show-inheritance:"
    if KINDS["classes"](thing):
        return f".. autoclass:: {module.__name__}.{name}\n   :members:{_undocumented(thing)}{_inherited(thing)}"
    words = "\n".join(f"   {line}" for line in _as_restructured_text(_words_under(module.__name__, name)))
    return f".. py:data:: {name}\n   :module: {module.__name__}\n\n{words}"


def _undocumented(thing: type) -> str:
    """The option that lists fields without words of their own, where no signature does."""
    is_made_of_fields = issubclass(thing, BaseModel) or is_typeddict(thing) or getattr(thing, "_is_protocol", False)
    return "\n   :undoc-members:" if is_made_of_fields else ""


def _inherited(thing: type) -> str:
    """The option that adds what comes from bases of ours, and nothing that comes from another package."""
    _, *bases = thing.__mro__
    foreign = [base.__name__ for base in bases if not base.__module__.startswith("smartplay_")]
    return f"\n   :inherited-members: {', '.join(foreign)}" if len(foreign) < len(bases) else ""


def _words_under(package: str, name: str) -> list[str]:
    """The string that stands under a constant, in whichever module of ours defines it."""
    value = getattr(sys.modules[package], name)
    ours = sorted(module for module in sys.modules if module.startswith("smartplay_"))
    # A name may mean something else in another package; the module that defines this one has the same object.
    for module in sorted(ours, key=lambda module: not module.startswith(package)):
        if vars(sys.modules[module]).get(name) is value:
            words = ModuleAnalyzer.for_module(module).find_attr_docs().get(("", name))
            if words:
                return words
    raise ValueError(f"{package}.{name} has no words under it.")


def _as_restructured_text(lines: list[str]) -> list[str]:
    return [re.sub(r"(?<![`:])`([^`]+)`(?!`)", r"``\1``", line) for line in lines]


def _process_docstring(app: Sphinx, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    if what == "class" and lines and lines[0].startswith(f"{thing.__name__}("):
        lines.clear()  # what `dataclass` writes where there is no docstring
    lines[:] = _as_restructured_text(lines)
    if inspect.isroutine(thing) or inspect.isclass(
        thing
    ):  # anywhere else "a: b" is a sentence, not a list of arguments
        lines[:] = str(GoogleDocstring(lines, NAPOLEON, app, what, name, thing, options)).splitlines()
    elif what == "attribute":
        lines[:] = [*lines, "", *_default(*name.rsplit(".", 2))]


def _default(module: str, owner: str, field: str) -> list[str]:
    """What a field of a pydantic model is where it is not given: its class keeps no attribute that tells."""
    model = getattr(importlib.import_module(module), owner)
    if not issubclass(model, BaseModel) or field not in model.model_fields or model.model_fields[field].is_required():
        return []
    return [f"Default: ``{model.model_fields[field].get_default(call_default_factory=True)!r}``."]


def _process_signature(
    app: Sphinx, what: str, name: str, thing: Any, options: Any, signature: str | None, returns: str | None
) -> tuple[str | None, str | None]:
    """A pydantic model is made of its fields by name; a protocol is not made at all."""
    if what == "class" and issubclass(thing, BaseModel):
        return _fields(thing), None
    if what == "class" and getattr(thing, "_is_protocol", False):
        return "", None
    if signature is not None and len(returns or "") > LONGEST_TYPE:
        returns = str(inspect.signature(thing).return_annotation)
    return signature and signature.replace("<factory>", "..."), returns  # not Python, and not laid out


def _fields(model: type[BaseModel]) -> str:
    """The signature of a pydantic model: its fields and what they are where they are not given."""
    given = [
        name if field.is_required() else f"{name}={field.get_default(call_default_factory=True)!r}"
        for name, field in model.model_fields.items()
    ]
    return f"(*, {', '.join(given)})"


def _skip(app: Sphinx, what: str, name: str, thing: Any, skip: bool, options: Any) -> bool | None:
    return True if name in INHERITED_MACHINERY or name.startswith("_") else None


def _resolve(app: Sphinx, env: BuildEnvironment, node: pending_xref, content: nodes.Element) -> nodes.Node | None:
    """A type is documented where it is public and named where it is defined; one that is not ours stays a word."""
    if node.get("refdomain") != "py":
        return None
    package, _, path = node["reftarget"].partition(".")
    public = f"{package}.{path.split('.')[-1]}"
    reference = env.get_domain("py").resolve_xref(env, node["refdoc"], app.builder, "obj", public, node, content)
    return reference or content


def setup(app: Sphinx) -> dict[str, Any]:
    """Called by Sphinx."""
    # Before Sphinx looks at anything: some frameworks' models cannot be built once it has.
    importable()
    importlib.import_module("smartplay_openai.agents")
    app.add_directive("all-adapters", AllAdapters)
    app.add_directive("public-names", PublicNames)
    app.connect("autodoc-process-docstring", _process_docstring)
    app.connect("autodoc-process-signature", _process_signature)
    app.connect("autodoc-skip-member", _skip)
    app.connect("missing-reference", _resolve)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
