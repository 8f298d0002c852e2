"""The populations of a rank: nodes, faces, links and steps."""
