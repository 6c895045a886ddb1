"""What every room speaks: mechanisms, branches, statuses, tolerances, requests. Imports nothing of jaxkin."""
