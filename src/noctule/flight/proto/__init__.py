"""The messages of a recording; `flight_pb2` is generated from `flight.proto` (see its first lines)."""
