"""Makes nodes of checked elements: registry and builder."""
