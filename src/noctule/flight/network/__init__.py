"""One process per sensor: nodes of the fusion that share their contributions over eclipse-zenoh."""
