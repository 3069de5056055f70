"""The version of the package, and the date of the format of decks."""

__version__ = "0.1.0"
#: date of the format of decks and tables, not the day of writing, so that the same scene gives the same bytes
FORM_DATE = "2026-11-21"
