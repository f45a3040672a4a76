"""A reason to doubt a result, as a careful colleague would say it."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Doubt:
    """Something about a fit that a person should know before trusting it. All fields are plain English.

    name: a fixed word for the kind of doubt, for programs, such as ``search_bound``.
    where: phase, parameter or view that it is about.
    what: was seen, with numbers; a clause.
    cause: why that is likely so; a clause.
    remedy: what to do about it; a clause.
    """

    name: str
    where: str
    what: str
    cause: str
    remedy: str

    def __str__(self) -> str:
        return f"doubt: {self.where}: {self.what}. Likely cause: {self.cause}. Remedy: {self.remedy}."
