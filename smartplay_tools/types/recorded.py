"""The base class of recorded data, which leaves out newer fields where older versions meant the same."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Self

from pydantic import BaseModel, ConfigDict, Field, SerializerFunctionWrapHandler, model_serializer


class Recorded(BaseModel):
    """Data of a record. A newer field is left out at the value that older records imply, so these stay valid.

    `model_fields` and attributes have all fields.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    later: ClassVar[Mapping[str, Any]] = {}
    """The newer fields, each with the value that a record without it has; the default can be another value."""

    @model_serializer(mode="wrap")
    def _without_what_was_before(self, serialize: SerializerFunctionWrapHandler) -> dict[str, Any]:
        dumped: dict[str, Any] = serialize(self)
        for name, before in self.later.items():
            value = getattr(self, name)
            if value == before:
                dumped.pop(name, None)
            else:
                dumped.setdefault(name, value)  # a default, where defaults are left out
        return dumped

    @classmethod
    def from_record(cls, data: Mapping[str, Any]) -> Self:
        """Return the data of a record, in which newer fields may be missing."""
        return cls(**{**cls.later, **data})


Count = Annotated[int, Field(strict=True, ge=0)]

Cap = Annotated[int, Field(strict=True, ge=1)]
