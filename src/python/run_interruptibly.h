#pragma once

#include <pybind11/pybind11.h>

#include <chrono>
#include <future>

#include "acmp_mapping/reconstruction/stop_request.h"

namespace acmp::python {

/// Runs `work` in a thread of its own without Python's lock, so that other Python threads go on, and throws what it
/// throws. Meanwhile Python's signal handlers run: where one raises (Ctrl-C: KeyboardInterrupt, in the main thread) the
/// work is stopped and that is thrown.
/// @param work takes a StopRequest*; must not touch Python
template <class Work>
void RunInterruptibly(const Work& work) {
  const pybind11::gil_scoped_release release;
  StopRequest stop;
  std::future<void> done = std::async(std::launch::async, [&] {
    stop.RunCancellable([&] { work(&stop); });
    stop.Check();
  });
  constexpr std::chrono::milliseconds kTimeToReact(50);
  while (done.wait_for(kTimeToReact) != std::future_status::ready) {
    const pybind11::gil_scoped_acquire acquire;
    if (PyErr_CheckSignals() == 0) continue;
    stop.Request();
    const pybind11::error_already_set raised;
    {
      const pybind11::gil_scoped_release while_waiting;
      done.wait();
    }
    throw raised;
  }
  done.get();
}

}  // namespace acmp::python
