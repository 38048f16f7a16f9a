"""Run by alembic on the connection that `registry.index` opened, inside its transaction."""

from alembic import context

from paddlectl.registry.schema import metadata

context.configure(
    connection=context.config.attributes["connection"], target_metadata=metadata, render_as_batch=True
)
context.run_migrations()
