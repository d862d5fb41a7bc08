"""Programs as the system under test: started in a folder of their own, watched, ended, and read."""
