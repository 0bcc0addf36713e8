"""`python -m litegrip_fleet` is the command `litegripd-fleet`."""

from litegrip_fleet.admin.main import run

if __name__ == "__main__":
    run()
