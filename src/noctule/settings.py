"""The base of every group of settings that a mission file may hold."""

from pydantic import BaseModel, ConfigDict


class Settings(BaseModel):
    """Validated, frozen, strict about unknown keys; each room defines its own groups next to their use."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
