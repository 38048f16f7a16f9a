"""What users call a run: a name of its own, and tags."""

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0004"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Adds both, empty."""
    op.add_column("runs", sa.Column("name", sa.Text))
    op.add_column("runs", sa.Column("tags", sa.Text, nullable=False, server_default="[]"))


def downgrade() -> None:
    """Drops both."""
    with op.batch_alter_table("runs") as batch:
        batch.drop_column("tags")
        batch.drop_column("name")
