//! The connection of a panel's page without a browser.

use std::net::TcpStream;

use tungstenite::WebSocket;
use tungstenite::handshake::client::generate_key;
use tungstenite::http::Request;

/// Returns the address and the secret of a page.
pub(crate) fn parts(url: &str) -> (&str, &str) {
    let rest = url.strip_prefix("http://").expect("an address");
    rest.split_once("/#").expect("a secret")
}

/// Connects like the page.
pub(crate) fn connected(url: &str) -> WebSocket<TcpStream> {
    let (address, _) = parts(url);
    let stream = TcpStream::connect(address).expect("it listens");
    let request = Request::builder()
        .uri(format!("ws://{address}/live"))
        .header("Host", address)
        .header("Origin", format!("http://{address}"))
        .header("Connection", "Upgrade")
        .header("Upgrade", "websocket")
        .header("Sec-WebSocket-Version", "13")
        .header("Sec-WebSocket-Key", generate_key())
        .body(());
    let request = request.expect("a request");
    let (socket, _) = tungstenite::client(request, stream).expect("a WebSocket");
    socket
}
