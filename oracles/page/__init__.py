"""The page of a report: its facts, sections, pictures, and words."""
