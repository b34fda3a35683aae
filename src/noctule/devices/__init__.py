"""What a vehicle and a camera are, and one module per product."""
