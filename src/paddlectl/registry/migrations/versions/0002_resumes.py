"""How often a run was resumed. From here on every run and policy has a manifest as well."""

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Adds the count."""
    op.add_column("runs", sa.Column("resumes", sa.Integer, nullable=False, server_default="0"))


def downgrade() -> None:
    """Drops it."""
    with op.batch_alter_table("runs") as batch:
        batch.drop_column("resumes")
