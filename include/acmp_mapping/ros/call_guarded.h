#pragma once

#include <exception>
#include <functional>
#include <new>
#include <string>

#include <xmlrpcpp/XmlRpcException.h>

namespace acmp {

/// Told what an exception says.
using FailureReport = std::function<void(const std::string&)>;

/// Calls a function of a callback, a timer or a thread. What it throws is told and goes no further: an exception that
/// leaves one of these would end the whole nodelet manager.
template <class Function>
void CallGuarded(const Function& function, const FailureReport& report) {
  try {
    try {
      function();
    } catch (const std::bad_alloc&) {
      report("out of memory");
    } catch (const std::exception& error) {
      report(error.what());
    } catch (const XmlRpc::XmlRpcException& error) {  // no std::exception
      report(error.getMessage());
    } catch (...) {
      report("an exception that says nothing");
    }
  } catch (...) {  // of the report: there is no memory for it
  }
}

}  // namespace acmp
