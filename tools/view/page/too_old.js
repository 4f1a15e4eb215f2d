// A plain script that any browser can read: says so if the browser cannot run the rest.
(function () {
  "use strict";
  // A page that is one file with its log needs more.
  var isRecording = document.documentElement.hasAttribute("data-recording");
  function works() {
    try {
      if (
        isRecording &&
        !(typeof DecompressionStream === "function" && HTMLScriptElement.supports("importmap"))
      ) {
        return false;
      }
      return (
        "noModule" in document.createElement("script") &&
        typeof ResizeObserver === "function" &&
        typeof WebSocket === "function" &&
        typeof structuredClone === "function"
      );
    } catch (error) {
      return false;
    }
  }
  if (works()) return;
  document.addEventListener("DOMContentLoaded", function () {
    var note = document.getElementById("too-old");
    note.textContent =
      "This browser is too old for this page. It needs " +
      (isRecording
        ? "Chrome or Edge 98, Firefox 113, Safari 16.4"
        : "Chrome or Edge 98, Firefox 94, Safari 15.4") +
      ", or a later one.";
    note.className = "banner";
    note.hidden = false;
  });
})();
