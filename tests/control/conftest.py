from hypothesis import settings

# Deadlines measure the machine, not the code: on a loaded runner they fail by chance.
settings.register_profile("no_deadline", parent=settings.default, deadline=None)
settings.load_profile("no_deadline")
