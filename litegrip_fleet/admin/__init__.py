"""The program `litegripd-fleet`: its configuration, the access table, certificates, `check`."""
