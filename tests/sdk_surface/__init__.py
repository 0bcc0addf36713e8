"""The vendor SDK's surface beyond its manual: names, arguments, meanings; docs/sdk-compat.md."""
