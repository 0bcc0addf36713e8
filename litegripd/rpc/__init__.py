"""JSON-RPC without a socket: text in, text out, and the table of methods."""
