"""What a page has for itself: buttons to open files, what became of them, and why something wasn't done.

All else on the pages is the same for all. viser tells everybody, and everybody who comes later, how far the upload of a
shared button is; so each page has its own.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import viser
from viser._messages import FileTransferStartUpload, RemoveNotificationMessage

from basenet_jax.plots.drawing import FAILED
from basenet_jax.viewer import words

_NOTICE_S = 12.0  # that a message about one person's file stays
_REFUSED = "That can't be done"

Open = Callable[[str, bytes], str | None]  # of a file's name and content; what it returns is told


@dataclass
class _Visitor:
    client: viser.ClientHandle
    warning: viser.GuiHtmlHandle
    uploads: list[str] = field(default_factory=list)  # identities of transfers


class Visitors:
    """All pages that are open.

    Args:
        server: of the pages.
        files: the folder of the panel that the buttons go to.
        open_scene: told of scene files, and
        open_plan: of plan files; both may raise `ValueError`.
    """

    def __init__(
        self, server: viser.ViserServer, files: viser.GuiFolderHandle, open_scene: Open, open_plan: Open
    ) -> None:
        self._files, self._open_scene, self._open_plan = files, open_scene, open_plan
        self._visitors: dict[int, _Visitor] = {}
        server.on_client_connect(self._welcome)
        server.on_client_disconnect(self._forget)

    def warn(self, client_id: int | None, text: str) -> None:
        """Tells one person why something was not done; until the next change."""
        if (visitor := self._visitors.get(-1 if client_id is None else client_id)) is not None:
            visitor.warning.content = words.paragraph(text, color=FAILED)
            visitor.warning.visible = True

    def withdraw_warnings(self) -> None:
        """Something has changed."""
        for visitor in list(self._visitors.values()):
            if visitor.warning.visible:
                visitor.warning.visible = False

    async def _welcome(self, client: viser.ClientHandle) -> None:
        warning = client.gui.add_html("", order=0.0, visible=False)
        visitor = self._visitors[client.client_id] = _Visitor(client, warning)
        with self._files:
            scenes = client.gui.add_upload_button("Open a scene file", mime_type=".yaml,.yml,.json")
            plans = client.gui.add_upload_button("Open a plan file", mime_type=".json")
        scenes.on_upload(lambda event: self._opened(visitor, event, self._open_scene))
        plans.on_upload(lambda event: self._opened(visitor, event, self._open_plan))

        def began(_: int, message: FileTransferStartUpload) -> None:
            visitor.uploads.append(message.transfer_uuid)

        client._websock_connection.register_handler(FileTransferStartUpload, began)

    def _forget(self, client: viser.ClientHandle) -> None:
        self._visitors.pop(client.client_id, None)

    def _opened(self, visitor: _Visitor, event: viser.GuiEvent[viser.GuiUploadButtonHandle], use: Open) -> None:
        file = event.target.value
        try:
            note = use(file.name, file.content)
        except ValueError as error:
            for upload in visitor.uploads:  # the page says of each that it was "uploaded successfully"
                visitor.client._websock_connection.queue_message(RemoveNotificationMessage(f"upload-{upload}"))
            visitor.client.add_notification(_REFUSED, str(error), auto_close_seconds=_NOTICE_S, color="red")
        else:
            if note:
                visitor.client.add_notification("Note", note, auto_close_seconds=_NOTICE_S)
        visitor.uploads.clear()
