"""Warnings of the pipeline, at the reader's own line."""

from ..datasets import user_warnings
from .errors import PalpateWarning


def warn_user(message: str, category: type[Warning] = PalpateWarning) -> None:
    """Warn at the innermost line that is not palpate's."""
    user_warnings.warn_user(message, category)
