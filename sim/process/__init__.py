"""Any program as the system under test: started in a folder of its own, watched, ended, and read for what it wrote."""
