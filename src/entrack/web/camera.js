// Post the camera's frames, one after the other, until the server has had enough.
async (address) => {
  if (!navigator.mediaDevices) throw new Error("needs https, or the page on this very computer");
  const stream = await navigator.mediaDevices.getUserMedia({ video: { width: 640, height: 480 } });
  try {
    const video = Object.assign(document.createElement("video"), { srcObject: stream, muted: true });
    await video.play();
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = [video.videoWidth, video.videoHeight];
    for (let answer = { ok: true }; answer.ok; ) {
      const soon = new Promise((then) => setTimeout(then, 33));
      canvas.getContext("2d").drawImage(video, 0, 0);
      const body = await new Promise((then) => canvas.toBlob(then, "image/jpeg", 0.92));
      answer = await fetch(address, { method: "POST", body });
      await soon;
    }
  } finally {
    stream.getTracks().forEach((track) => track.stop());
  }
}
