"""Numbers as a scenario takes them, and what all of its parts have in common."""

from __future__ import annotations

from typing import Annotated, TypeAlias

from pydantic import BaseModel, ConfigDict, Field, model_validator

LONGEST = 600.0  # [s]: the bound on every time in a scenario, and so on simulated time

LARGEST = 1e6  # of any other number, in its unit: beyond, products overflow, and no arm is so large or strong

# Strict: 0.3 and 1 are numbers, "0.3" and true are not.
Number: TypeAlias = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-LARGEST, le=LARGEST)]
Positive: TypeAlias = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0, le=LARGEST)]
NotNegative: TypeAlias = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0, le=LARGEST)]
Time: TypeAlias = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0, le=LONGEST)]
Duration: TypeAlias = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0, le=LONGEST)]
Count: TypeAlias = Annotated[int, Field(strict=True, ge=1)]
Seed: TypeAlias = Annotated[int, Field(strict=True, ge=0, lt=2**63)]
Flag: TypeAlias = Annotated[bool, Field(strict=True)]
Vector: TypeAlias = Annotated[tuple[Number, ...], Field(min_length=1)]
Point: TypeAlias = tuple[Number, Number, Number]
Place: TypeAlias = tuple[Number, Number]
Range: TypeAlias = tuple[Number, Number]
PositiveRange: TypeAlias = tuple[Positive, Positive]


class Part(BaseModel):
    """A frozen part of a scenario, in which an unknown key is an error, so that misspelt ones are found."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    @model_validator(mode="after")
    def _ranges_ascend(self) -> Part:
        for name in type(self).model_fields:
            if name.endswith("_range") and (ends := getattr(self, name)) is not None and ends[0] > ends[1]:
                raise ValueError(f"{name}: the first number must not be above the second.")
        return self
