"""The version, for all who print it, and the date of the form in which decks are written."""

__version__ = "0.1.0"
#: date of the form of decks and tables, not of the day they are written: the same scene gives the same bytes
FORM_DATE = "2026-11-21"
