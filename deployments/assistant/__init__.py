"""The assistant: tools of the Model Context Protocol over campaign directories, for this user alone."""
