"""The answer as a read-only value: samples, peaks, crossing times and their uncertainties."""
