/* The system calls of a frame, for a compiled gateway: what gateway/system.py has where this is missing.

   They never block, or wait without the interpreter's lock, and make no object that nobody asked for. No rule
   of the wire belongs here. */

#define PY_SSIZE_T_CLEAN
#include <Python.h>

#include <errno.h>
#include <limits.h>
#include <sys/epoll.h>
#include <sys/timerfd.h>
#include <time.h>
#include <unistd.h>

#define MOST_READ 4096
#define MOST_FOUND 64
#define NS_PER_S 1000000000LL

static int
is_called_with(Py_ssize_t given, Py_ssize_t wanted, const char *name)
{
    if (given == wanted)
        return 1;
    PyErr_Format(PyExc_TypeError, "%s() takes %zd arguments, not %zd", name, wanted, given);
    return 0;
}

/* The number of a descriptor; an error is set where it cannot be one. */
static int
descriptor_of(PyObject *number)
{
    long value = PyLong_AsLong(number);

    if (value > INT_MAX || value < INT_MIN)
        PyErr_SetString(PyExc_OverflowError, "no descriptor has this number");
    return (int)value;
}

static PyObject *
boot_ns(PyObject *Py_UNUSED(module), PyObject *Py_UNUSED(nothing))
{
    struct timespec now;

    if (clock_gettime(CLOCK_BOOTTIME, &now))
        return PyErr_SetFromErrno(PyExc_OSError);
    return PyLong_FromLongLong(now.tv_sec * NS_PER_S + now.tv_nsec);
}

static PyObject *
read_bytes(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t given)
{
    char buffer[MOST_READ];
    int descriptor;
    long size;
    ssize_t got;

    if (!is_called_with(given, 2, "read"))
        return NULL;
    descriptor = descriptor_of(arguments[0]);
    size = PyLong_AsLong(arguments[1]);
    if (PyErr_Occurred())
        return NULL;
    if (size < 0 || size > MOST_READ)
        return PyErr_Format(PyExc_ValueError, "read() of %ld bytes: 0 to %d", size, MOST_READ);
    do
        got = read(descriptor, buffer, (size_t)size);
    while (got < 0 && errno == EINTR && !PyErr_CheckSignals());
    if (PyErr_Occurred())
        return NULL;
    return got < 0 ? PyErr_SetFromErrno(PyExc_OSError) : PyBytes_FromStringAndSize(buffer, got);
}

static PyObject *
write_bytes(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t given)
{
    int descriptor;
    char *data;
    Py_ssize_t size;
    ssize_t taken;

    if (!is_called_with(given, 2, "write"))
        return NULL;
    descriptor = descriptor_of(arguments[0]);
    if (PyErr_Occurred() || PyBytes_AsStringAndSize(arguments[1], &data, &size))
        return NULL;
    do
        taken = write(descriptor, data, (size_t)size);
    while (taken < 0 && errno == EINTR && !PyErr_CheckSignals());
    if (PyErr_Occurred())
        return NULL;
    return taken < 0 ? PyErr_SetFromErrno(PyExc_OSError) : PyLong_FromSsize_t(taken);
}

static PyObject *
wait_for(PyObject *epoll, PyObject *const *arguments, Py_ssize_t given)
{
    struct epoll_event events[MOST_FOUND];
    long most, timeout;
    int descriptor, count, number;
    PyObject *found;

    if (!is_called_with(given, 2, "wait"))
        return NULL;
    descriptor = descriptor_of(epoll);
    timeout = PyLong_AsLong(arguments[0]);
    most = PyLong_AsLong(arguments[1]);
    if (PyErr_Occurred())
        return NULL;
    if (timeout != 0 && timeout != -1)
        return PyErr_Format(PyExc_ValueError, "wait() of %ld: -1 or 0", timeout);
    if (most < 1 || most > MOST_FOUND)
        return PyErr_Format(PyExc_ValueError, "wait() for %ld: 1 to %d", most, MOST_FOUND);
    if (timeout) {
        Py_BEGIN_ALLOW_THREADS
        count = epoll_wait(descriptor, events, (int)most, -1);
        Py_END_ALLOW_THREADS
    } else
        count = epoll_wait(descriptor, events, (int)most, 0);
    if (count < 0) {
        if (errno != EINTR)
            return PyErr_SetFromErrno(PyExc_OSError);
        if (PyErr_CheckSignals())
            return NULL;
        count = 0;
    }
    found = PyList_New(count);
    for (number = 0; found != NULL && number < count; number++) {
        PyObject *pair = PyTuple_New(2);
        PyObject *which = PyLong_FromLong(events[number].data.fd);
        PyObject *what = PyLong_FromUnsignedLong(events[number].events);

        if (pair == NULL || which == NULL || what == NULL) {
            Py_XDECREF(pair);
            Py_XDECREF(which);
            Py_XDECREF(what);
            Py_CLEAR(found);
            break;
        }
        PyTuple_SET_ITEM(pair, 0, which);
        PyTuple_SET_ITEM(pair, 1, what);
        PyList_SET_ITEM(found, number, pair);
    }
    return found;
}

static PyMethodDef wait_definition = {
    "wait", (PyCFunction)(void (*)(void))wait_for, METH_FASTCALL,
    "wait(timeout, most) -> list of descriptors and events",
};

static PyObject *
waiting(PyObject *Py_UNUSED(module), PyObject *epoll)
{
    if (!PyLong_Check(epoll))
        return PyErr_Format(PyExc_TypeError, "waiting() takes the descriptor of an epoll");
    return PyCFunction_NewEx(&wait_definition, epoll, NULL);
}

static PyObject *
set_at(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t given)
{
    struct itimerspec wanted = {{0, 0}, {0, 0}};
    int timer;
    long long at_ns;

    if (!is_called_with(given, 2, "set_at"))
        return NULL;
    timer = descriptor_of(arguments[0]);
    at_ns = PyLong_AsLongLong(arguments[1]);
    if (PyErr_Occurred())
        return NULL;
    wanted.it_value.tv_sec = at_ns / NS_PER_S;
    wanted.it_value.tv_nsec = at_ns % NS_PER_S;
    if (timerfd_settime(timer, TFD_TIMER_ABSTIME, &wanted, NULL))
        return PyErr_SetFromErrno(PyExc_OSError);
    Py_RETURN_NONE;
}

static PyMethodDef functions[] = {
    {"boot_ns", boot_ns, METH_NOARGS, "boot_ns() -> int"},
    {"read", (PyCFunction)(void (*)(void))read_bytes, METH_FASTCALL, "read(descriptor, size) -> bytes"},
    {"write", (PyCFunction)(void (*)(void))write_bytes, METH_FASTCALL, "write(descriptor, data) -> int"},
    {"set_at", (PyCFunction)(void (*)(void))set_at, METH_FASTCALL, "set_at(timer, ns)"},
    {"waiting", waiting, METH_O, "waiting(descriptor) -> what waits for the descriptors of that epoll"},
    {NULL, NULL, 0, NULL},
};

static struct PyModuleDef definition = {
    PyModuleDef_HEAD_INIT, "gateway._system", "See gateway/system.py.", -1, functions, NULL, NULL, NULL, NULL,
};

PyMODINIT_FUNC
PyInit__system(void)
{
    return PyModule_Create(&definition);
}
