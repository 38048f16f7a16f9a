"""The first schema: runs and policies."""

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None
branch_labels = None
depends_on = None

LONG = sa.BigInteger().with_variant(sa.Integer, "sqlite")


def upgrade() -> None:
    """Creates both tables."""
    op.create_table(
        "runs",
        sa.Column("id", sa.Integer, nullable=False),
        sa.Column("kind", sa.Text, nullable=False),
        sa.Column("method", sa.Text, nullable=False),
        sa.Column("task", sa.Text, nullable=False),
        sa.Column("scenario", sa.Text),
        sa.Column("sources", sa.Text, nullable=False),
        sa.Column("seed", LONG, nullable=False),
        sa.Column("status", sa.Text, nullable=False),
        sa.Column("settings", sa.Text, nullable=False),
        sa.Column("versions", sa.Text, nullable=False),
        sa.Column("frames", LONG, nullable=False),
        sa.Column("episodes", LONG, nullable=False),
        sa.Column("seconds", sa.Float, nullable=False),
        sa.Column("results", sa.Text, nullable=False),
        sa.Column("created", sa.Text, nullable=False),
        sa.Column("finished", sa.Text),
        sa.PrimaryKeyConstraint("id", name="pk_runs"),
        sqlite_autoincrement=True,
    )
    op.create_table(
        "policies",
        sa.Column("id", sa.Integer, nullable=False),
        sa.Column("run", sa.Integer, nullable=False),
        sa.Column("task", sa.Text, nullable=False),
        sa.Column("domain", sa.Text, nullable=False),
        sa.Column("method", sa.Text, nullable=False),
        sa.Column("seed", LONG, nullable=False),
        sa.Column("frames", LONG, nullable=False),
        sa.Column("program", sa.Text, nullable=False),
        sa.Column("checkpoint", sa.Text, nullable=False),
        sa.Column("success_rate", sa.Float, nullable=False),
        sa.Column("mean_score", sa.Float, nullable=False),
        sa.Column("mean_length", sa.Float, nullable=False),
        sa.Column("crispness", sa.Float, nullable=False),
        sa.Column("created", sa.Text, nullable=False),
        sa.Column("metadata", sa.Text, nullable=False),
        sa.PrimaryKeyConstraint("id", name="pk_policies"),
        sa.ForeignKeyConstraint(["run"], ["runs.id"], name="fk_policies_run"),
        sqlite_autoincrement=True,
    )
    op.create_index("ix_policies_run", "policies", ["run"])
    op.create_index("ix_policies_task", "policies", ["task"])


def downgrade() -> None:
    """Drops both tables."""
    op.drop_table("policies")
    op.drop_table("runs")
