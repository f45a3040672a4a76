"""A session on disk."""

from __future__ import annotations

FILE = "session.json"
