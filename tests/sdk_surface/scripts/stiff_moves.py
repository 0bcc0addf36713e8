from litegrip import LiteGrip

with LiteGrip("can0") as g:
    g.load_calibration()
    g.enable()
    for position in (50, 20, 80):
        if not g.goto(position, 150.0, 2.0):
            print("missed", position)
    closed = g.config.pos_closed_rad
    g.goto_rad(closed + 0.3 * -g.config.close_sign, 120.0, 2.0, 0.0, 0.0, 1.0)
    for _ in range(200):
        g.send_mit_frame(closed - 0.5 * g.config.close_sign, 60.0, 1.5, 0.0, 0.0)
        g.poll(0.01)
    print("done", round(g.get_position()))
