"""The same as last time? Another question than: right? Both are answered, side by side."""
