def draw_node(*a):
    pass


def register():
    pass


def unregister():
    pass
