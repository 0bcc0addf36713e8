/* Page and server prove to each other that they know the secret; neither sends it (see proof.py).

   The secret is in this page's memory alone: whoever has the port later, and with it what a browser
   stores for this address, finds nothing. */

const NONCE_BYTES = 32;
const ascii = new TextEncoder();

export class Secret {
  #key;

  constructor(token) {
    const algorithm = { name: "HMAC", hash: "SHA-256" };
    this.#key = crypto.subtle.importKey("raw", ascii.encode(token), algorithm, false, ["sign"]);
  }

  /* Return the proof of `role`, "page" or "server", for a connection with these nonces. */
  async proof(role, pageNonce, serverNonce) {
    const host = location.host.toLowerCase();
    const text = ["litegripd-web", role, host, pageNonce, serverNonce].join("\n");
    const bytes = await crypto.subtle.sign("HMAC", await this.#key, ascii.encode(text));
    return [...new Uint8Array(bytes)].map((byte) => byte.toString(16).padStart(2, "0")).join("");
  }
}

/* Return a nonce, in letters of base64url. */
export function newNonce() {
  const bytes = crypto.getRandomValues(new Uint8Array(NONCE_BYTES));
  return btoa(String.fromCharCode(...bytes)).replaceAll("+", "-").replaceAll("/", "_").replaceAll("=", "");
}
