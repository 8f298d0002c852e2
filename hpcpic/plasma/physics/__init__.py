"""The equations and schemes, as the papers write them."""
