"""Export of a campaign directory: its formats, which are plug-ins."""
