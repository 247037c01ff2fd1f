"""What a plan costs: driving, picking, and the judge that executes a plan."""
