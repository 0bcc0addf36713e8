/* Reads a dump beside the page: a large or a damaged one never keeps STOP from being pressed. */

import { readDump } from "./mcap.js";

onmessage = async ({ data: file }) => {
  try {
    const onProgress = (share) => postMessage({ share });
    postMessage({ dump: readDump(new Uint8Array(await file.arrayBuffer()), onProgress) });
  } catch (error) {
    postMessage({ error: error.message });
  }
};
