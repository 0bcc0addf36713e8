"""JSON-RPC without a socket: text in, text out, and the methods."""
