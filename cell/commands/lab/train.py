"""`cell lab train`: one network, with all its options."""

from cell.commands.training.tasks import train_app as app_of

train_app = app_of()
