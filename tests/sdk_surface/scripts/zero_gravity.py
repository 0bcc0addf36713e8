from litegrip import LiteGrip

with LiteGrip("can0") as g:
    g.enable()
    g.enter_zero_gravity(duration=3.0)
    print("holding", not g.is_moving())
    g.enter_zero_gravity()
    g.exit_zero_gravity()
