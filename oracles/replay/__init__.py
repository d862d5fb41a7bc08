"""Pictures of one run that was executed once more."""
