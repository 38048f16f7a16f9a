"""Policies of methods without clauses: neither a program nor a crispness."""

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Lets both be missing."""
    _alter(nullable=True)


def downgrade() -> None:
    """Demands both; where they are missing, an empty program and a crispness of 0 stand in for them."""
    op.execute("UPDATE policies SET program = coalesce(program, ''), crispness = coalesce(crispness, 0.0)")
    _alter(nullable=False)


def _alter(*, nullable: bool) -> None:
    """SQLite makes the table anew; ids that were given once are remembered, so that none is given again."""
    connection = op.get_bind()
    sqlite = connection.dialect.name == "sqlite"
    last = sa.text("SELECT seq FROM sqlite_sequence WHERE name = 'policies'")
    given = connection.scalar(last) if sqlite else None
    with op.batch_alter_table("policies", table_kwargs={"sqlite_autoincrement": True}) as batch:
        batch.alter_column("program", existing_type=sa.Text, nullable=nullable)
        batch.alter_column("crispness", existing_type=sa.Float, nullable=nullable)
    if given is not None:
        connection.execute(sa.text("DELETE FROM sqlite_sequence WHERE name = 'policies'"))
        again = sa.text("INSERT INTO sqlite_sequence (name, seq) VALUES ('policies', :given)")
        connection.execute(again, {"given": given})
