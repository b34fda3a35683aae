"""What decides: deterministic state machines from observations to decisions."""
